from glob import glob

from setuptools import find_packages, setup

package = "ema_dashboard"

setup(
    name=package,
    version="0.2.0",
    description="The dashboard node: the graph for Foxglove and for a web page of its own.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={package: ["page/*"]},
    install_requires=[
        "ema_archive",
        "ema_core",
        "ema_bags",
        "ema_ros",
        "aiohttp>=3.13,<4",
        "prometheus-client>=0.22,<1",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/layouts", glob("layouts/*")),
    ],
    zip_safe=False,
    entry_points={"console_scripts": ["dashboard_node = ema_ros.programs:dashboard_node"]},
)
