from setuptools import find_packages, setup

package = "ema_archive"

setup(
    name=package,
    version="0.2.0",
    description="Bags of a fleet to tables of estimates, health and life, again where it is due.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={package: ["*.sql"]},
    install_requires=[
        "ema_core",
        "ema_monitor",
        "ema_bags",
        "duckdb>=1.4,<2",
        "fsspec>=2025.9",
        "numpy>=1.26,<3",
        "pyarrow>=21,<27",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
)
