"""Hidden worlds the long way: legs turn, cameras film, bags are written, markers tracked; then the analysis."""

import math
import tempfile
from pathlib import Path

import yaml
from tqdm import tqdm

import hidden
from _figures import Figure, share
from sandbot_bringup.tools import campaign
from sandbot_lab.world import write_world
from sandbot_record.trials.csv_table import read_csv

PHI, OMEGA, REPLICATES = hidden.PHI, hidden.OMEGA, 3
NAMES = (
    "disturbed_ground(k_l_n_per_m=175, s_c=0.95)",
    "exact_vertical_acceleration()",
    "exact_leg_arc(tip_deg=45)",
    "stance_overlap(eta=0.1)",
    "swimming_thrust(a_m_s2=0.32)",
    "crater_refill(z0_m=0.01, tau_s=0.15)",
    "phi_dependent_response(b=0.6)",
    "belly_coast(mu_b=0.9)",
    "motor_saturation(omega_s_rad_s=50)",
    "carried_momentum(chi_m=0.6)",
    "inertial_drag(lambda_=2)",
    "slow_phase_speed(SGCS)",
    "leg_slip(sigma=0.1)",
    "disturbed_ground + stance_overlap",
    "x_resonance(loss=0.3, omega_0_rad_s=12, width_rad_s=2)",
    "x_traction_loss(loss=0.4)",
    "null",
    "null",
)


def filmed(case: hidden.Case) -> hidden.Outcome:
    """One world, measured from video."""
    world = case.world
    plan = {"name": "filmed", "seed": case.seed, "gait": world.gait}
    plan |= {"phi": PHI, "omega_rad_s": OMEGA, "replicates": REPLICATES}
    with tempfile.TemporaryDirectory() as folder:
        path, out, lab = (Path(folder) / name for name in ("plan.yaml", "out", "world.yaml"))
        path.write_text(yaml.safe_dump(plan))
        write_world(world.world(case.noise), lab)
        arguments = [str(path), "--out", str(out), "--batch", "--world", str(lab), "--images", "none"]
        if code := campaign.main(arguments):
            raise RuntimeError(f"{world.name}: campaign ended with exit code {code}")
        return hidden.judged(case, read_csv(out / "trials.csv"), math.nan)


def sample() -> list[Figure]:
    """One world of each kind."""
    worlds = {world.name: world for world in (*hidden.WORLDS, hidden.NULL)}
    kinds = {worlds[name].kind: (seed, worlds[name]) for seed, name in enumerate(NAMES, start=700)}
    found = [filmed(hidden.Case(world, seed)) for seed, world in kinds.values()]
    return share("right verdicts", "worlds through film and tracker", [one.good for one in found], "≥ 95 %")


def main() -> str:
    """The section of the report, in Markdown."""
    worlds = {world.name: world for world in (*hidden.WORLDS, hidden.NULL)}
    lines = [
        "# Hidden worlds through tracked video",
        "",
        f"{len(PHI)} φ × {len(OMEGA)} ω × {REPLICATES} replicates of each world: `campaign --batch` films and tracks "
        "every trial, `discover` gets its table and nothing else.",
        "",
        "| world | verdict | right | cv error / noise floor |",
        "|---|---|---|---|",
    ]
    for seed, name in enumerate(tqdm(NAMES), start=700):
        got = filmed(hidden.Case(worlds[name], seed))
        lines.append(f"| {name} | {hidden.said(got)} | {'yes' if got.good else 'no'} | {got.cv_over_floor:.2f} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(main())
