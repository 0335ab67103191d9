"""unseal: open the virtual lab's sealed truth and compare the discovery with it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import SCHEMAS, read_plan
from sandbot_bringup.truth import judge, truth_of
from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import read_json
from sandbot_lab.world import read_world
from sandbot_model.physics.walking import BASES


def main(argv: Sequence[str] | None = None) -> int:
    """Console script; exit code 1 if the verdict and the truth disagree."""
    return cli.run(command, argv)


def command(argv: Sequence[str]) -> int:
    """Print verdict, error before and after, noise floor, and whether the sealed truth agrees."""
    parser = cli.Parser(prog="unseal", description=__doc__)
    parser.add_argument("folder", type=Path, help="a campaign of the virtual lab")
    parser.add_argument("--discovery", type=Path, help="what discover --json wrote (default: FOLDER/discovery.json)")
    options = parser.parse_args(argv)
    folder = CampaignFolder(options.folder)
    path = options.discovery or options.folder / "discovery.json"
    discovery = _read(path, folder)
    try:
        found = summary(discovery)
        truth = truth_of(read_world(folder.truth), read_plan(folder.plan_file))
        # Effects of the base model are not searched for, so the verdict can't name them.
        agreement = judge(truth - set(BASES.get(discovery.get("model", ""), ())), discovery["verdict"])
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(f"{path}: not a whole discovery of schema sandbot.discovery/1 or /2: {error!r}") from None
    print(found)
    print(f"truth:   {'agrees' if agreement.agrees else 'DISAGREES'}: {agreement.line}")
    return 0 if agreement.agrees else 1


def summary(discovery: dict[str, Any]) -> str:
    """Verdict and error before and after against the noise floor, in cm/s."""
    verdict, steps = discovery["verdict"], discovery["steps"]
    last = next((step for step in steps if step["effects"] == verdict["effects"]), steps[-1])
    named = " + ".join(verdict["effects"]) or "none"
    floor = discovery["noise_floor_m_s"]
    errors = " -> ".join(f"{_cm_s(step['cv_rmse_m_s'])}" for step in (steps[0], last))
    return (
        f"verdict: {verdict['status']} ({named}): {verdict['because']}\n"
        f"error:   out of sample {errors} cm/s; noise floor {'unknown' if floor is None else _cm_s(floor)} cm/s"
    )


def _cm_s(speed_m_s: float | None) -> str:
    return "unknown" if speed_m_s is None else f"{speed_m_s * 100.0:.2f}"


def _read(path: Path, campaign: CampaignFolder) -> dict[str, Any]:
    make = f"; make it with: trackway discover {campaign.path} --json {path}"
    none = f", and no {campaign.truth}: is it a campaign of the virtual lab?"
    content = read_json(path, remedy=make if campaign.truth.exists() else none)
    if not isinstance(content, dict) or content.get("schema") not in SCHEMAS:
        raise InputError(f"{path}: not a discovery of schema {' or '.join(SCHEMAS)}")
    if not content.get("steps"):
        raise InputError(f"{path}: a discovery with no steps")
    return content
