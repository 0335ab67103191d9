"""Walking models on granular ground: compare them with measurements and find the effect that is missing.

    import sandbot_model as sm
    found = sm.discover("table.csv")     # a path, a folder of bags, a DataFrame, Trials
    found                                # verdict, ladder, parameters
    found.fit.to_frame(); found.plot(); sm.compare("table.csv", effects=["stance_overlap"]).plot()

The subpackages, each of which imports only those above it in this list:

    physics/    robot, chain of quantities, walking, effects/ (one file each), catalogue, formula, predictor
    data/       trials gathered into cells, with their pure error
    fitting/    likelihood, global minimum, fit, leave-one-out, goodness
    discovery/  compare, discover, verdict, next trials
    design/     what to run next and when to stop
    report/     figures and the self-contained page
    explore/    the interactive page
    predictor_parameters, nodes/  the predictor for the running trial (predictor_node)
    tools/      the commands
"""

from typing import TYPE_CHECKING

from sandbot_common.lazy import attach

if TYPE_CHECKING:
    from sandbot_common.errors import InputError
    from sandbot_model.discovery.criteria import Criteria
    from sandbot_model.physics.chain import Chain
    from sandbot_model.physics.effect import Effect, Parameter, Values
    from sandbot_model.tools.python_api import compare, discover
    from sandbot_record.trials.read import read
    from sandbot_record.trials.table import Trials

__all__ = (
    "Chain",
    "Criteria",
    "Effect",
    "InputError",
    "Parameter",
    "Trials",
    "Values",
    "compare",
    "discover",
    "read",
)

_MODULES = {
    "discover": ".tools.python_api",
    "compare": ".tools.python_api",
    "read": "sandbot_record.trials.read",
    "Trials": "sandbot_record.trials.table",
    "Criteria": ".discovery.criteria",
    "Effect": ".physics.effect",
    "Parameter": ".physics.effect",
    "Values": ".physics.effect",
    "Chain": ".physics.chain",
    "InputError": "sandbot_common.errors",
}
__getattr__, __dir__ = attach(__name__, _MODULES)
