from setuptools import find_packages, setup

package = "ema_tasks"

setup(
    name=package,
    version="0.2.0",
    description="Tasks on threads, processes or a Dask cluster; a killed worker loses none.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    install_requires=["ema_core"],
    extras_require={"dask": ["distributed>=2026.1"]},
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
)
