from glob import glob

from setuptools import find_packages, setup

NAME = "sandbot_bringup"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.py")),
        (f"share/{NAME}/config", glob("config/*.*")),
    ],
    python_requires=">=3.11",
    install_requires=[
        "sandbot_common",
        "sandbot_clock",
        "sandbot_bed",
        "sandbot_tracking",
        "sandbot_model",
        "sandbot_lab",
        "sandbot_record",
        "numpy",
        "pyyaml",
        "plotly",
        "tqdm",
        "flask",
        "werkzeug",
        "opencv-python-headless",
        "scipy",
    ],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="Launch files, configuration, the campaign runner and the console.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "campaign = sandbot_bringup.tools.campaign:main",
            "console = sandbot_bringup.console_parameters:main",
            "scene = sandbot_bringup.scene_parameters:main",
            "unseal = sandbot_bringup.tools.unseal:main",
        ]
    },
)
