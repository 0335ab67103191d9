from setuptools import find_packages, setup

NAME = "sandbot_common"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["ros/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["numpy", "numba", "pyyaml"],
    extras_require={
        "test": ["pytest", "hypothesis"],
        "frames": ["pandas"],
        "cluster": ["dask", "distributed", "cloudpickle"],
    },
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="Shared by all packages: input errors, command lines, typed parameters, node wiring, message builders.",
    license="Apache-2.0",
)
