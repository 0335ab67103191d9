"""What to measure next as tables to fill in, to be run by hand (``campaign --plan`` runs the trials of the JSON)."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from sandbot_common.files import write_text, writing
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_record.trials.csv_table import write_csv
from sandbot_record.trials.table import Row, from_rows


def write_trials_to_run(next_trials: Sequence[NextTrial], already: int, path: Path, instead: str) -> str:
    """Write a row for every replicate of the trials, and into ``readings_file`` one for every penetrometer reading; the
    text to print, ``instead`` of which says why no trial is proposed. ``already`` is the number of trials so far, which
    keeps ids apart."""
    trials, readings = (_in_turn([one for one in next_trials if one.kind == kind]) for kind in ("trial", "reading"))
    said = [
        f"{path}: {_write_trials(trials, already, path)}" if trials else f"{path} is not written, because {instead}"
    ]
    if readings:
        said.append(f"{readings_file(path)}: {_write_readings(readings, readings_file(path))}")
    return ". ".join(said)


def readings_file(path: Path) -> Path:
    """The table of readings beside that of trials: next.csv, next.readings.csv."""
    return path.with_suffix(f".readings{path.suffix}")


def _in_turn(measurements: Sequence[NextTrial]) -> list[tuple[NextTrial, int]]:
    """Each with the number of its replicate, one replicate of each condition after the other, so that what drifts
    meanwhile is no effect."""
    most = max((one.replicates for one in measurements), default=0)
    return [(one, number) for number in range(1, most + 1) for one in measurements if number <= one.replicates]


def _write_trials(runs: Sequence[tuple[NextTrial, int]], already: int, path: Path) -> str:
    rows = [
        Row(f"next{already + at:03d}", trial.phi, omega_rad_s=trial.omega_rad_s, gait=trial.gait, replicate=number)
        for at, (trial, number) in enumerate(runs, start=1)
    ]
    with writing(path):
        write_csv(from_rows(rows), path)
    return f"{len(rows)} trials to run and to fill in; then give both tables to discover"


def _write_readings(readings: Sequence[tuple[NextTrial, int]], path: Path) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("phi", "depth_m", "force_n"))
    writer.writerows((reading.phi, reading.depth_m, "") for reading, _ in readings)
    with writing(path):
        write_text(path, text.getvalue())
    return f"{len(readings)} readings to make and to fill in; then give it to discover with --penetrometer"
