"""What an analysis assumes as neither the data nor an option say it: robot, gait, accuracy of cameras, bed, drift."""

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.physics.gait import assumption
from sandbot_record.trials.table import Trials

NO_ROBOT = "robot: not given, SandBot is assumed"


def assumed(trials: Trials, cells: Cells, criteria: Criteria | None = None) -> tuple[str, ...]:
    """One sentence for each assumption; those on the bed matter to a verdict only, which has ``criteria``."""
    robot = NO_ROBOT if trials.robot is None else ""
    return tuple(filter(None, (robot, assumption(cells.gait), *priors_assumed(trials, cells, criteria))))


def priors_assumed(trials: Trials, cells: Cells, criteria: Criteria | None) -> tuple[str, ...]:
    """Assumed standard deviations of calibration errors and, for a verdict, of the bed's stiffness, and that it does
    not drift; empty if given, or if the order of trials is."""
    accuracy = cells.accuracy
    zero = f"a zero of the lift within {1e3 * accuracy.lift_zero_m:.2g} mm and " if "lift" in cells.observables else ""
    scale = f"a scale of speed within {100 * accuracy.speed_scale:.2g} %"
    cameras = f"cameras: accuracy not given, {zero}{scale} (s.d.) assumed"
    bed = f"bed: scatter not given, {100 * DEFAULT.bed_scatter:.2g} % of k from batch to batch (s.d.) assumed"
    usual = criteria is not None and criteria.bed_scatter == DEFAULT.bed_scatter
    steady = "order of trials: not given, no drift of k is assumed"
    unordered = criteria is not None and cells.order is None
    return (
        *([cameras] if trials.accuracy is None else []),
        *([bed] if usual else []),
        *([steady] if unordered else []),
    )
