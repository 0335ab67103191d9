"""Which effects a campaign will be able to detect, predicted before it is run."""

from collections.abc import Mapping, Sequence

from sandbot_bringup.config import robot_of
from sandbot_bringup.plan import Plan, PlannedTrial
from sandbot_common.errors import InputError
from sandbot_common.files import parse_yaml


def foresight(plan: Plan, trials: Sequence[PlannedTrial], files: Mapping[str, str]) -> str:
    """The prediction in one sentence, for the ground of Li09 and the usual scatter according to cameras.yaml."""
    from sandbot_model.discovery.effect_search import EffectSearch
    from sandbot_model.discovery.power import detectable, expected, in_words
    from sandbot_model.physics.catalogue import catalogue
    from sandbot_record.trials.setting import accuracy_of
    from sandbot_record.trials.table import Row, from_rows

    cameras = parse_yaml(files["cameras.yaml"], "cameras.yaml")
    rows = [
        Row(
            trial_id=trial.trial_id,
            phi=trial.phi,
            omega_rad_s=trial.omega_rad_s,
            gait=trial.gait or plan.gait_name,
            replicate=trial.replicate,
            speed_m_s=0.0,
            batch=trial.batch,
            run_order=trial.run_order,
        )
        for trial in trials
    ]
    try:
        base = expected(from_rows(rows, robot_of(files), accuracy=accuracy_of(cameras, "cameras.yaml")))
    except InputError as error:
        return f"what it will be able to find can't be predicted: {error}"
    search = EffectSearch(base.cells, catalogue(), "simple")
    return f"effects {in_words(detectable(search, base), search.names)}"
