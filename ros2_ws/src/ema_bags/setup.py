from glob import glob

from setuptools import find_packages, setup

package = "ema_bags"

setup(
    name=package,
    version="0.2.0",
    description="Bags in the conventions of rosbag2, and telemetry of other makes.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    install_requires=[
        "ema_core",
        "ema_monitor",
        "ema_ros",
        "mcap>=1.2,<2",
        "numpy>=1.26,<3",
        "pandas>=2.2,<4",
        "pyarrow>=21,<27",
        "pyyaml>=6,<7",
        "rosbags>=0.11,<0.12",
        "zstandard>=0.22,<1",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/mappings", glob("mappings/*")),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "bridge_node = ema_ros.programs:bridge_node",
            "player_node = ema_ros.programs:player_node",
            "recorder_node = ema_ros.programs:recorder_node",
        ],
    },
)
