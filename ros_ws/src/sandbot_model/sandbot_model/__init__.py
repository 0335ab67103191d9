"""Walking models on granular ground, effects, fit, compare, discover.

    physics/    robot, chain of quantities, walking, effects/ (one file each), catalogue, formula, predictor
    data/       trials gathered into cells, with their pure error
    fitting/    likelihood, global minimum, fit, leave-one-out, goodness
    discovery/  compare, discover, verdict, next trials
    report/     figures and the self-contained page
    explore/    the interactive page
    tools/      the commands

Each imports only what stands above it here (pyproject.toml holds it to that).
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Chain": "physics.chain",
    "Effect": "physics.effect",
    "Parameter": "physics.effect",
    "Values": "physics.effect",
}
"""Where each public name lives; it is imported when it is asked for, so that no command waits for what it needs not."""

__all__ = tuple(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
