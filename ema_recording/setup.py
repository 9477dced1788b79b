from setuptools import find_packages, setup

package = "ema_recording"

setup(
    name=package,
    version="0.2.0",
    description="MCAP recordings in the conventions of rosbag2, with recorder and player nodes.",
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
        "pyyaml>=6,<7",
        "rosbags>=0.11,<0.12",
        "zstandard>=0.22,<1",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "player_node = ema_recording.player_node:main",
            "recorder_node = ema_recording.recorder_node:main",
        ],
    },
)
