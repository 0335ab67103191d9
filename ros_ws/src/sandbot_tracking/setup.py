from setuptools import find_packages, setup

NAME = "sandbot_tracking"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=["sandbot_common", "numpy", "scipy", "numba", "opencv-python-headless", "pyyaml"],
    extras_require={"test": ["pytest", "hypothesis"], "frames": ["pandas"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="Camera frames to markers, metres and forward speed.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "tracker = sandbot_tracking.tracker_parameters:main",
            "camera = sandbot_tracking.camera_parameters:main",
            "calibrate = sandbot_tracking.tools.calibrate:main",
            "track_video = sandbot_tracking.tools.track_video:main",
        ]
    },
)
