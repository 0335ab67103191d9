"""Walking models on granular ground: compare them with measurements and find the effect that is missing.

    import sandbot_model as sm
    found = sm.discover("table.csv")     # a path, a folder of bags, a DataFrame, Trials
    found                                # verdict, ladder, parameters
    found.fit.to_frame(); found.plot(); sm.compare("table.csv", effects=["stance_overlap"]).plot()

The rooms, each of which imports only those above it in this list:

    physics/    robot, chain of quantities, walking, effects/ (one file each), catalogue, formula, predictor
    data/       trials gathered into cells, with their pure error
    fitting/    likelihood, global minimum, fit, leave-one-out, goodness
    discovery/  compare, discover, verdict, next trials
    report/     figures and the self-contained page
    explore/    the interactive page
    tools/      the commands
"""

from importlib import import_module
from typing import Any

_HOME = {
    "discover": "sandbot_model.tools.door",
    "compare": "sandbot_model.tools.door",
    "read": "sandbot_record.trials.read",
    "Trials": "sandbot_record.trials.table",
    "Criteria": "sandbot_model.discovery.criteria",
    "Effect": "sandbot_model.physics.effect",
    "Parameter": "sandbot_model.physics.effect",
    "Values": "sandbot_model.physics.effect",
    "Chain": "sandbot_model.physics.chain",
    "InputError": "sandbot_common.errors",
}
"""Where each public name lives; it is imported when asked for, so that no command waits for what it does not use."""

__all__ = tuple(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
