from setuptools import find_packages, setup

NAME = "sandbot_bed"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["sandbot_common", "numpy"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="The fluidised bed: pulse protocol and volume fraction with its uncertainty.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["bed = sandbot_bed.bed_parameters:main"]},
)
