from setuptools import find_packages, setup

package = "ema_monitor"

setup(
    name=package,
    version="0.2.0",
    description="Fault identification and prognosis of an actuator, and its node.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={package: ["calibration/builtin_calibration.yaml"]},
    install_requires=[
        "ema_core",
        "numpy>=1.26,<3",
        "numba>=0.61,<1",
        "pyyaml>=6,<7",
        "scipy>=1.11,<2",
    ],
    extras_require={"plot": ["matplotlib>=3.8,<4"], "states": ["scikit-learn>=1.4,<2"]},
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={"console_scripts": ["monitor_node = ema_ros.programs:monitor_node"]},
)
