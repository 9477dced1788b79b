from setuptools import find_packages, setup

package = "ema_ros"

setup(
    name=package,
    version="0.2.0",
    description="Shared by the nodes: messages, topics, lifecycle, parameters and status.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    install_requires=[
        "ema_core",
        "numpy>=1.26,<3",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
)
