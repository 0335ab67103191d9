"""A node must not name an attribute as rclpy's Node does: it would overwrite the one ROS works with."""

import ast
from pathlib import Path

import pytest
import rclpy.node

SOURCE = Path(__file__).parents[2] / "ros_ws" / "src"


def attributes_set(tree):
    """Names x of every ``self.x = …`` in a module."""
    for node in ast.walk(tree):
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for target in targets:
            for part in ast.walk(target):
                if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id == "self":
                    yield part.attr


def names(path):
    return set(attributes_set(ast.parse(path.read_text())))


RESERVED = names(Path(rclpy.node.__file__)) | set(dir(rclpy.node.Node))


@pytest.mark.parametrize("path", sorted(SOURCE.glob("*/*/nodes/*_node.py")), ids=lambda path: path.stem)
def test_no_attribute_of_ros_is_overwritten(path):
    assert not names(path) & RESERVED


def test_the_check_would_find_one():
    tree = ast.parse("class A:\n    def __init__(self):\n        self._parameters, self.b = 1, 2")
    assert set(attributes_set(tree)) & RESERVED == {"_parameters"}
