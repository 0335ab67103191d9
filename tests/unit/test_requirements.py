"""Each package declares what it imports, and nothing else, so that it installs into somebody's own environment."""

import ast
import json
import re
import sys
from pathlib import Path

import pytest

import sandbot_common

SOURCE = Path(sandbot_common.__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in SOURCE.glob("*/setup.py"))
WHEEL = {"yaml": "pyyaml", "cv2": "opencv-python-headless", "serial": "pyserial", "rerun": "rerun-sdk"}
"""Where a wheel is not called what is imported from it."""
ROS = {"rclpy", "ament_index_python", "rcl_interfaces", "builtin_interfaces", "std_srvs"}
"""From a ROS 2 installation (package.xml), with all that ends in _msgs; only nodes and their messages need it."""


def imported(package: str) -> set[str]:
    """Everything imported anywhere in a package that is neither Python's, nor ROS's, nor its own."""
    names = set()
    for path in (SOURCE / package / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.split(".")[0])
    return {
        WHEEL.get(name, name)
        for name in names - ROS - sys.stdlib_module_names - {package}
        if not name.endswith("_msgs")
    }


def declared(package: str) -> set[str]:
    """What setup.py names in install_requires and extras_require."""
    tree = ast.parse((SOURCE / package / "setup.py").read_text())
    (call,) = (node.value for node in tree.body if isinstance(node, ast.Expr))
    given = {one.arg: one.value for one in call.keywords}
    extras = ast.literal_eval(given["extras_require"])
    assert extras.pop("test") == ["pytest", "hypothesis"]  # by which `colcon test` knows the package for one with tests
    return {*ast.literal_eval(given["install_requires"]), *(name for names in extras.values() for name in names)}


BY_WAY_OF = {"sandbot_common": {"dask"}}
"""Declared though never imported by us: the workers of a cluster are started with its command."""


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_declares_what_it_imports(package):
    assert declared(package) == imported(package) | BY_WAY_OF.get(package, set())


def test_an_import_is_seen():
    assert {"numpy", "pyyaml"} <= imported("sandbot_common")
    assert "rclpy" not in imported("sandbot_common")


@pytest.mark.parametrize("package", PACKAGES)
def test_colcon_test_runs_the_package_s_tests(package):
    folder, *_ = json.loads((SOURCE / package / "colcon.pkg").read_text())["pytest-args"]
    tests = (SOURCE / package / folder).resolve()
    assert tests.name == package
    assert list(tests.rglob("test_*.py"))


DISTRIBUTION = {"pyyaml": "yaml", "opencv-python-headless": "opencv", "rosbags": "rosbags-pip", "dash": "dash-pip",
                "pyserial": "serial"}  # fmt: skip
"""Where rosdep's key is not python3- and the wheel's name."""

KEYLESS = {"asteval", "av", "lz4", "mcap", "plotly", "rerun-sdk", "zstandard"}
"""Wheels for which ros/rosdistro has no key (rosdep/python.yaml of 22 August 2026): named in a comment."""

LAUNCH = {"launch", "launch_ros", "sandbot_hardware"}
"""Of launch files, and of the node table."""


def of_ros(package: str) -> set[str]:
    """The ROS packages imported anywhere in a package."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (SOURCE / package / package).rglob("*.py"))
    found = set(re.findall(r"^ *(?:from|import) (\w+)", text, flags=re.MULTILINE))
    return {name for name in found if name in ROS or name.endswith("_msgs")}


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_names_the_same(package):
    """As a package of the distribution, or as a wheel in a comment; and no package that nobody imports."""
    text = (SOURCE / package / "package.xml").read_text(encoding="utf-8")
    depends = set(re.findall(r"<exec_depend>(.+?)</exec_depend>", text))
    comments = set(re.findall(r"[\w-]+", " ".join(re.findall(r"<!--(.*?)-->", text, flags=re.DOTALL))))
    named = {name: f"python3-{DISTRIBUTION.get(name, name)}" for name in declared(package)}
    wheels = {name for name in named if not name.startswith("sandbot_")}
    missing = {name for name in wheels if named[name] not in depends and name not in comments}
    missing |= ({name for name in named if name not in wheels} | of_ros(package)) - depends
    assert not missing
    assert not depends & {f"python3-{name}" for name in KEYLESS}
    assert depends <= {named[name] for name in wheels} | (set(named) - wheels) | of_ros(package) | LAUNCH
