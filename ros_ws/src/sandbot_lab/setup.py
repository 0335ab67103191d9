from setuptools import find_packages, setup

NAME = "sandbot_lab"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["sandbot_common", "sandbot_clock", "numpy", "numba", "opencv-python-headless", "pyyaml"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="The virtual lab: a time-domain ground truth in place of robot, bed and cameras.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "lab = sandbot_lab.lab_parameters:main",
            "penetrometer = sandbot_lab.tools.penetrometer:main",
        ]
    },
)
