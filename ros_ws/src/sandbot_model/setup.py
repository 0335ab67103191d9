from setuptools import find_packages, setup

NAME = "sandbot_model"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={NAME: ["report/*.j2", "report/*.css", "report/*.js", "explore/assets/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=[
        "sandbot_common",
        "sandbot_record",
        "numpy",
        "scipy",
        "numba",
        "pyyaml",
        "plotly",
        "jinja2",
        "markupsafe",
        "tqdm",
        "asteval",
        "emcee",
        "opencv-python-headless",
    ],
    extras_require={
        "test": ["pytest", "hypothesis"],
        "explore": ["dash", "flask", "werkzeug", "av"],
        "rerun": ["rerun-sdk"],
        "frames": ["pandas"],
        "plot": ["matplotlib"],
    },
    zip_safe=True,
    maintainer="trackway maintainers",
    maintainer_email="maintainers@trackway.example",
    description="Walking models on granular ground, effects, fit, compare, discover.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "predictor = sandbot_model.predictor_parameters:main",
            "compare = sandbot_model.tools.compare:main",
            "discover = sandbot_model.tools.discover:main",
            "explore = sandbot_model.tools.explore:main",
            "atlas = sandbot_model.tools.atlas:main",
            "export = sandbot_model.tools.export:main",
            "effects = sandbot_model.tools.effects:main",
        ]
    },
)
