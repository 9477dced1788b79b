from setuptools import find_packages, setup

package = "ema_sim"

setup(
    name=package,
    version="0.2.0",
    description="Reference model of an electromechanical actuator with faults, and its node.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    install_requires=[
        "ema_core",
        "numba>=0.61,<1",
        "numpy>=1.26,<3",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={"console_scripts": ["actuator_node = ema_ros.programs:actuator_node"]},
)
