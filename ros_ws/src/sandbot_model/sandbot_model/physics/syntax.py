"""Expressions as Python's syntax trees."""

import ast
import threading

_PARSING = threading.Lock()


def tree(expression: str) -> ast.expr:
    """The tree of an expression, parsed in one thread at a time: Python 3.11 counts the depth of all threads' trees
    together and raises SystemError where a second one begins within the first (CPython issue 106905). Raises what
    ``ast.parse`` does for text that is no expression.
    """
    with _PARSING:
        return ast.parse(expression, mode="eval").body
