"""The figures of a trial's page: its records against time, and the replicates against the phase of the legs."""

from collections.abc import Sequence

import numpy as np

from sandbot_common.arrays import Floats
from sandbot_model.explore.scene import Scene, phases
from sandbot_model.physics.observables import CM
from sandbot_model.report import text
from sandbot_model.report.figures import as_json
from sandbot_model.report.theme import Spec, Theme, axis, layout
from sandbot_model.report.waveforms import DASHES, Waveform

DOMAINS = {"y": [0.5, 1.0], "y2": [0.24, 0.44], "y3": [0.0, 0.17]}


def records(scene: Scene, theme: Theme) -> Spec:
    """Measured and modelled v_x(t), the angles of both tripods, and the bed, in stacked panels."""
    shown, turned = scene.waveform, np.degrees(_broken(scene.turned))
    colours = theme.model_colours(6)
    data = [
        _line("model", shown.leg_time_s, CM * scene.model_m_s, theme.faint, width=4),
        _line("measured", shown.time_s, CM * shown.speed_m_s, colours[1]),
        *(
            _line(f"tripod {name}", shown.leg_time_s, turned[:, i], colour, axis="y2")
            for i, (name, colour) in enumerate(zip("AB", (colours[4], colours[2]), strict=True))
        ),
        *_bed(scene, colours),
    ]
    reach = float(np.degrees(scene.reach_rad))
    band = {
        "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "yref": "y2", "y0": -reach, "y1": reach,
        "fillcolor": theme.empty, "line": {"width": 0}, "layer": "below",
    }  # fmt: skip
    across = axis(theme, "time from the start of the legs (s)", range=[min(0.0, float(shown.time_s[0])), scene.end_s])
    ups = {
        "yaxis": axis(theme, "v<sub>x</sub> (cm/s)", domain=DOMAINS["y"]),
        "yaxis2": axis(theme, "leg angle (°)", domain=DOMAINS["y2"], range=[-180, 180], tickvals=[-180, 0, 180]),
        "yaxis3": axis(theme, "bed", domain=DOMAINS["y3"], rangemode="tozero", nticks=3),
    }
    spec: Spec = {"data": data, "layout": layout(theme, 520, xaxis=across | {"anchor": "y3"}, shapes=[band], **ups)}
    spec["layout"]["margin"] |= {"t": 56}
    return spec


def _bed(scene: Scene, colours: Sequence[str]) -> list[Spec]:
    """The bed's height and the air flow, as far as recorded."""
    names = {"height_m": ("height of the bed (cm)", CM), "blower": ("air (0 to 1)", 1.0)}
    return [
        _line(words, times, scale * values, colours[3 if name == "blower" else 0], axis="y3", shape="hv")
        for name, (words, scale) in names.items() if name in scene.bed
        for times, values in [_extended(*scene.bed[name], scene.end_s)]
    ]  # fmt: skip


def _extended(times: Floats, values: Floats, end_s: float) -> tuple[Floats, Floats]:
    """A record with its last value extended to the end."""
    return np.append(times, end_s), np.append(values, values[-1])


def _broken(angle_rad: Floats) -> Floats:
    """The angle with NaN where it wraps from π to -π, so that no line is drawn there."""
    broken = angle_rad.copy()
    broken[1:][np.abs(np.diff(angle_rad, axis=0)) > np.pi] = np.nan
    return broken


def _line(
    name: str, x: Floats, y: Floats, colour: str, width: float = 1.8, axis: str = "y", shape: str = "linear"
) -> Spec:
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": as_json(x), "y": as_json(y), "yaxis": axis,
        "line": {"color": colour, "width": width, "shape": shape}, "hoverinfo": "skip",
    }  # fmt: skip


def over_phase(scene: Scene, waveforms: Sequence[Waveform], theme: Theme) -> Spec:
    """v_x of every replicate, and the model's, against the angle of the first tripod, from the second period on."""
    colours = theme.model_colours(len(waveforms) + 1)[1:]
    data = []
    for i, (waveform, colour) in enumerate(zip(waveforms, colours, strict=True)):
        phase, speed = phases(waveform, scene.tripods[0])
        line = _line(waveform.trial_id, np.degrees(phase), CM * speed, colour, 1.2)
        line["line"]["dash"] = DASHES[i % len(DASHES)]
        data.append(line)
    model = Waveform(
        "model", scene.waveform.leg_time_s, scene.model_m_s, scene.waveform.leg_time_s, scene.waveform.leg_angle_rad,
        scene.waveform.leg_rate_rad_s,
    )  # fmt: skip
    phase, speed = phases(model, scene.tripods[0])
    data.insert(0, _line("model", np.degrees(phase), CM * speed, theme.faint, 4))
    across = axis(
        theme, "angle of tripod A from straight down (°)", range=[-180, 180], tickvals=[-180, -90, 0, 90, 180]
    )
    return {"data": data, "layout": layout(theme, 340, xaxis=across, yaxis=axis(theme, "v<sub>x</sub> (cm/s)"))}


def records_caption(scene: Scene) -> str:
    """Caption of ``records``."""
    speed = scene.waveform.speed_m_s
    holds = "swims: no leg holds" if scene.reach_rad <= 0 else (
        f"holds a leg within {np.degrees(scene.reach_rad):.0f}° of straight down"
    )  # fmt: skip
    return (
        f"{scene.waveform.trial_id}: forward speed up to {text.cm_s(float(np.nanmax(speed)))}; the model {holds} (grey "
        "band). Below: the angles of both tripods, and the bed."
    )


def phase_caption(waveforms: Sequence[Waveform]) -> str:
    """Caption of ``over_phase``."""
    return f"Forward speed of {len(waveforms)} replicates against the angle of tripod A, from the second period on."
