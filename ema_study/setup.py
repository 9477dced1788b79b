from setuptools import find_packages, setup

package = "ema_study"

setup(
    name=package,
    version="0.2.0",
    description="The thesis's study of optimizers, repeated.",
    license="Apache-2.0",
    maintainer="EMA health monitor maintainers",
    maintainer_email="maintainers@example.org",
    packages=find_packages(include=[package, f"{package}.*"]),
    package_data={package: ["thesis_runs.csv", "printed_tables/*.csv", "templates/*"]},
    install_requires=[
        "ema_core",
        "ema_monitor",
        "ema_sim",
        "jinja2>=3.1,<4",
        "matplotlib>=3.8,<4",
        "numpy>=1.26,<3",
        "pandas>=2.2,<4",
    ],
    python_requires=">=3.11",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
    ],
    zip_safe=True,
)
