from setuptools import find_packages, setup

NAME = "sandbot_record"

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
        "numpy",
        "pyyaml",
        "mcap",
        "rosbags",
        "lz4",
        "zstandard",
        "opencv-python-headless",
        "av",
    ],
    extras_require={"test": ["pytest", "hypothesis"], "frames": ["pandas"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="MCAP bags in and out, and the trials table made from them.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "record = sandbot_record.tools.record:main",
            "replay = sandbot_record.tools.replay:main",
            "recover = sandbot_record.tools.recover:main",
            "info = sandbot_record.tools.info:main",
            "table = sandbot_record.tools.table:main",
        ]
    },
)
