"""Every value of a YAML file by its path, and the file with one value changed."""

import copy

import numpy as np


def leaves(content, path=()):
    """Paths of all values in nested mappings and lists of them; a list of values is one, an empty one, too."""
    if isinstance(content, dict) and content:
        inside = content.items()
    elif isinstance(content, list) and isinstance(content[0], dict | list):
        inside = enumerate(content)
    else:
        return [path]
    return [leaf for key, value in inside for leaf in leaves(value, (*path, key))]


def elements(content, paths):
    """The same, and each element of a list by itself."""
    for path in paths:
        value = at(content, path)
        yield from ((*path, index) for index in range(len(value))) if isinstance(value, list) else [path]


def names(paths):
    """Paths as pytest shows them."""
    return [".".join(map(str, path)) for path in paths]


def at(content, path):
    """The value at a path."""
    for key in path:
        content = content[key]
    return content


def changed(content, path, value=None):
    """A copy with the value at ``path`` a little different, or ``value`` there."""
    copied = copy.deepcopy(content)
    at(copied, path[:-1])[path[-1]] = other(at(content, path)) if value is None else value
    return copied


def other(value):
    """A value of the same type, near by."""
    match value:
        case bool():
            return not value
        case int():
            return value + max(1, value // 10)
        case float():
            return value * 1.1 if value else 0.01
        case list():
            return [value[0] * 1.01 if isinstance(value[0], float) else other(value[0]), *value[1:]]
        case str():
            return f"{value}x"
    raise AssertionError(value)


def same(one, another):
    """Whether two sequences of arrays agree in every number, unknown ones included."""
    return all(
        np.shape(left) == np.shape(right) and np.array_equal(left, right, equal_nan=True)
        for left, right in zip(one, another, strict=True)
    )
