"""demo_found [--effects] FOLDER: the demo's last lines, with the result and the output files; or the effects' names."""

import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sandbot_common.files import read_json
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import Effect

WIDTH = 100
SAID = {
    "disturbed_ground": "a foot that lands within {s_c:.2f} R of the last foothold finds ground loosened to "
    "{k_l_n_per_m:.0f} N/m, and there walking turns into swimming",
    "belly_coast": "between steps the belly slides on, with a friction coefficient of {mu_b:.2f}",
    "slow_phase_speed": "the legs push only in the clock's slow phase, at {rho:.3f} of their mean rate",
}
"""What the paper's effects say of the ground, with the numbers fitted; others are said by their parameters."""


def found(discovery: Mapping[str, Any]) -> str:
    """The verdict in a sentence, with the fitted parameters and the error before and after."""
    first, last = discovery["steps"][0], discovery["steps"][-1]
    names, base = discovery["verdict"]["effects"], discovery["model"]
    if not names:
        return f"Found: no effect is claimed; the verdict is {discovery['verdict']['status']}."
    effects = catalogue()
    said = "; ".join(_said(effects[name], last["parameters"]) for name in names)
    return (
        f"Found: {said}. With that the {base} model misses trials it has not seen by {_cm_s(last)} cm/s, without it by "
        f"{_cm_s(first)}; replicates of one trial differ by {100 * discovery['noise_floor_m_s']:.2f}."
    )


def _said(effect: Effect, parameters: Mapping[str, Any]) -> str:
    values = {one.name: parameters[f"{effect.identifier}.{one.name}"]["value"] for one in effect.parameters}
    if effect.identifier in SAID:
        return SAID[effect.identifier].format(**values)
    numbers = ", ".join(f"{one.doc} {values[one.name]:.3g} {one.unit}".removesuffix(" 1") for one in effect.parameters)
    return f"{effect.identifier.replace('_', ' ')}{f' ({numbers})' if numbers else ''}"


def _cm_s(step: Mapping[str, float]) -> str:
    return f"{100 * step['cv_rmse_m_s']:.2f}"


def places(folder: Path) -> str:
    """The places of report, atlas, page and bags."""
    return (
        f"report    {folder}/report.html\n"
        f"atlas     {folder}/atlas, the figures of Li et al. 2009 from these trials\n"
        f"explorer  .venv/bin/trackway explore {folder}\n"
        f"bags      {folder}/trials, and {folder}-live/trials with every frame"
    )


def main(arguments: list[str]) -> int:
    """Print the result, or the effects' names."""
    folder = Path(arguments[-1])
    discovery = read_json(folder / "discovery.json")
    if arguments[0] == "--effects":
        print(",".join(discovery["verdict"]["effects"]))
    else:
        print(f"\n{textwrap.fill(found(discovery), WIDTH)}\n\n{places(folder)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
