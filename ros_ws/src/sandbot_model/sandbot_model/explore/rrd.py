"""A trial as a Rerun recording: film with marks, measured speed with its error, model, residual, legs and bed.

Everything is on two timelines: ``time``, from the start of the legs, and ``leg_phase``, the degrees that the first
tripod has turned, which aligns trials step by step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from sandbot_common import topics
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.files import whole_file
from sandbot_model.explore.scene import Scene
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials.film import Film

REMEDY = ".rrd needs the wheel rerun-sdk, which is not installed: `make rerun`, or pip install rerun-sdk"
LINES = {
    "speed/measured": ("v_x measured [m/s]", (194, 90, 0)),
    "speed/measured_minus_sd": ("v_x − σ", (236, 190, 150)),
    "speed/measured_plus_sd": ("v_x + σ", (236, 190, 150)),
    "speed/model": ("v_x of the model [m/s]", (118, 125, 134)),
    "residual/measured_minus_model": ("measured − model [m/s]", (194, 90, 0)),
    "legs/tripod_a": ("tripod A from straight down [rad]", (27, 31, 36)),
    "legs/tripod_b": ("tripod B from straight down [rad]", (118, 125, 134)),
    "bed/height_m": ("height of the bed [m]", (120, 96, 60)),
    "bed/blower": ("blower [1]", (0, 114, 178)),
    "bed/phi": ("volume fraction φ [1]", (120, 96, 60)),
}
"""Entity → (label, RGB colour)."""


@dataclass(frozen=True)
class Series:
    """One line: values at times [s] from the start of the legs."""

    entity: str
    time_s: Floats
    value: Floats


def series(scene: Scene, bag: Bag) -> list[Series]:
    """Every line of a trial that was measured. Raises InputError for a bag without speed."""
    measured = bag.columns(topics.SPEED.name, "twist.twist.linear.x", "twist.covariance", *FIELD_STAMP)
    time = (measured.stamp_ns - measured.stamp_ns[0]) * 1e-9 + float(scene.waveform.time_s[0])
    speed, sd = measured["twist.twist.linear.x"], np.sqrt(measured["twist.covariance"][:, 0])
    legs = scene.waveform.leg_time_s
    model = np.interp(time, legs, scene.model_m_s)
    found = [
        Series("speed/measured", time, speed),
        Series("speed/measured_minus_sd", time, speed - sd),
        Series("speed/measured_plus_sd", time, speed + sd),
        Series("speed/model", legs, scene.model_m_s),
        Series("residual/measured_minus_model", time, speed - model),
        *(Series(f"legs/tripod_{name}", legs, turned) for name, turned in zip("ab", scene.turned.T, strict=True)),
        *(Series(f"bed/{name}", *known) for name, known in scene.bed.items()),
    ]
    finite = [(line, np.isfinite(line.value)) for line in found]
    return [Series(line.entity, line.time_s[seen], line.value[seen]) for line, seen in finite if seen.any()]


def phase_deg(scene: Scene, time_s: Floats) -> Floats:
    """Degrees that the first tripod has turned since its start, rounded to whole degrees, at the given times."""
    turned = np.unwrap(scene.waveform.leg_angle_rad[:, scene.tripods[0]])
    start = np.interp(0.0, scene.waveform.leg_time_s, turned)
    return np.rint(np.rad2deg(np.interp(time_s, scene.waveform.leg_time_s, turned) - start))


def write_rrd(path: Path, scene: Scene, bag: Bag, film: Film | None) -> None:
    """Write the recording atomically. Raises InputError where Rerun is not installed."""
    rr = rerun()
    with whole_file(path) as part:
        recording = rr.RecordingStream("trackway", recording_id=scene.waveform.trial_id)
        recording.save(part, default_blueprint=_views(film is not None))
        for line in series(scene, bag):
            label, colour = LINES[line.entity]
            recording.log(line.entity, rr.SeriesLines(names=label, colors=[colour]), static=True)
            recording.send_columns(
                line.entity, _timelines(rr, scene, line.time_s), rr.Scalars.columns(scalars=line.value.astype(float))
            )
        if film is not None:
            _send_film(rr, recording, scene, film)
        recording.flush()
        recording.disconnect()


def _send_film(rr: ModuleType, recording: Any, scene: Scene, film: Film) -> None:
    shown = [i for i, t in enumerate(film.time_s) if scene.waveform.time_s[0] <= t <= scene.end_s]
    pictures = rr.EncodedImage.columns(blob=[film.jpeg(i) for i in shown], media_type=["image/jpeg"] * len(shown))
    recording.send_columns("film", _timelines(rr, scene, film.time_s[shown]), pictures)


def _timelines(rr: ModuleType, scene: Scene, time_s: Floats) -> Sequence[Any]:
    turned = phase_deg(scene, time_s).astype(np.int64)
    return [rr.TimeColumn("time", duration=time_s), rr.TimeColumn("leg_phase", sequence=turned)]


def _views(filmed: bool) -> Any:
    """The initial layout of the viewer."""
    import rerun.blueprint as rrb

    lines = [rrb.TimeSeriesView(origin=name, name=name) for name in ("speed", "residual", "legs", "bed")]
    film = [rrb.Spatial2DView(origin="film", name="lateral film, axles marked")] if filmed else []
    return rrb.Blueprint(rrb.Vertical(*film, *lines), collapse_panels=True)


def rerun() -> ModuleType:
    """The module ``rerun``, an optional dependency. Raises InputError where it is not installed."""
    try:
        import rerun as module
    except ImportError:
        raise InputError(REMEDY) from None
    found: ModuleType = module
    return found
