from setuptools import find_packages, setup

NAME = "sandbot_hardware"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=[
        "sandbot_common",
        "sandbot_tracking",
        "sandbot_lab",
        "numpy",
        "opencv-python-headless",
        "pyserial",
    ],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="Drivers of a bed, a leg controller and cameras on serial lines, and simulated devices for them.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "serial_legs = sandbot_hardware.serial_legs_parameters:main",
            "serial_bed = sandbot_hardware.serial_bed_parameters:main",
            "serial_camera = sandbot_hardware.serial_camera_parameters:main",
            "simulate = sandbot_hardware.simulate_command:main",
        ]
    },
)
