from setuptools import find_packages, setup

NAME = "sandbot_clock"

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
    description="The leg clock signal: gait parameters to leg set-points.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["clock = sandbot_clock.clock_parameters:main"]},
)
