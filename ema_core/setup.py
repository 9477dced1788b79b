from setuptools import find_packages, setup

package = "ema_core"

setup(
    name=package,
    version="0.2.0",
    description="Numerics and data shared by the simulator and the monitor of an actuator.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    install_requires=[
        "numpy>=1.26,<3",
        "llvmlite>=0.44,<1",
        "numba>=0.61,<1",
        "pyyaml>=6,<7",
    ],
    extras_require={"dask": ["distributed>=2026.1"]},
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
)
