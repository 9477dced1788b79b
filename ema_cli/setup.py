from setuptools import find_packages, setup

package = "ema_cli"

setup(
    name=package,
    version="0.2.0",
    description="The ema command: simulate, record, identify, predict and compare.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={f"{package}.report": ["templates/*"]},
    install_requires=[
        "ema_archive",
        "ema_core",
        "ema_dashboard",
        "ema_monitor",
        "ema_bags",
        "ema_ros",
        "ema_sim",
        "ema_study",
        "click>=8.1,<9",
        "jinja2>=3.1,<4",
        "markupsafe>=2.1,<4",
        "matplotlib>=3.8,<4",
        "numpy>=1.26,<3",
        "pandas>=2.2,<4",
        "pyyaml>=6,<7",
        "rich>=13,<16",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={"console_scripts": ["ema = ema_ros.programs:ema"]},
)
