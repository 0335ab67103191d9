"""The next trials as a trials table to fill in, to be run by hand (``campaign --plan`` runs those of the JSON)."""

from collections.abc import Sequence
from pathlib import Path

from sandbot_common.files import writing
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows


def write_trials_to_run(next_trials: Sequence[NextTrial], already: int, path: Path) -> str:
    """Write a row for every replicate, one replicate of each condition after the other, so that what drifts meanwhile
    is no effect; the line to print. ``already`` is the number of trials so far, which keeps ids apart."""
    walks = [trial for trial in next_trials if trial.kind == "trial"]
    most = max((trial.replicates for trial in walks), default=0)
    runs = [(trial, number) for number in range(1, most + 1) for trial in walks if number <= trial.replicates]
    if not runs:
        return f"{path} is not written: there is no next trial"
    rows = [
        Row(f"next{already + at:03d}", trial.phi, omega_rad_s=trial.omega_rad_s, gait=trial.gait, replicate=number)
        for at, (trial, number) in enumerate(runs, start=1)
    ]
    with writing(path):
        write_csv(from_rows(rows), path)
    return f"{path}: {len(rows)} trials to run and to fill in; then give both tables to discover"
