"""The world `li09_world.yaml` walks as the paper says SandBot does (reference/li09.yaml)."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from rig import CONFIG, QUIET, with_noise

from sandbot_clock.gait import Gait, leg_angles
from sandbot_common.robot import read_robot
from sandbot_lab.direct import readings
from sandbot_lab.robot import simulate
from sandbot_lab.world import read_world

ROOT = Path(__file__).resolve().parents[3]
PAPER = yaml.safe_load((ROOT / "reference/li09.yaml").read_text())
ROBOT = read_robot(CONFIG / "sgcs_robot.yaml")
LI09 = with_noise(read_world(CONFIG / "li09_world.yaml"), 0.0).walked_by(ROBOT)
PHI = (0.580, 0.590, 0.600, 0.611, 0.616, 0.622, 0.633)
OMEGA = np.arange(4.0, 30.5, 0.5)
FRAME_S = 0.01


def trace(phi, omega, gait="SGCS", world=LI09):
    t_s = np.arange(round(max(2.5, 8 * np.pi / omega) / FRAME_S * 10) + 1) * FRAME_S / 10
    return simulate(world, phi, t_s, *leg_angles(Gait.from_name(gait), omega, t_s), seed=1)


def speed(phi, omega, gait="SGCS", world=LI09):
    return readings(trace(phi, omega, gait, world), ROBOT.leg_mount_rad).speed_m_s


@cache
def curve(phi):
    return np.array([speed(phi, omega) for omega in OMEGA])


def oscillation(phi, omega):
    """Half the range of v_x(t) [m/s] as a camera of 100 frames/s sees it, the start left out."""
    seen = np.diff(trace(phi, omega).x_m[::10]) / FRAME_S
    settled = seen[len(seen) // 2 :]
    return (settled.max() - settled.min()) / 2


@pytest.mark.parametrize("anchor", PAPER["anchors"], ids=lambda anchor: anchor["name"])
def test_the_anchors(anchor):
    at = anchor["phi"], anchor["omega_rad_s"]
    assert speed(*at) == pytest.approx(anchor["speed_m_s"], abs=anchor["tolerance_m_s"])
    assert oscillation(*at) == pytest.approx(anchor["oscillation_m_s"], abs=anchor["oscillation_tolerance_m_s"])


@pytest.mark.slow
def test_the_top_speed():
    top = PAPER["top_speed"]
    assert max(curve(phi).max() for phi in PHI) == pytest.approx(top["speed_m_s"], abs=top["tolerance_m_s"])


@pytest.mark.parametrize("phi", PHI)
def test_fast_legs_swim_on_every_ground(phi):
    swims = PAPER["swimming"]
    fast = curve(phi)[swims["from_rad_s"] <= OMEGA]
    assert fast == pytest.approx(swims["speed_m_s"], abs=swims["tolerance_m_s"])


@pytest.mark.parametrize("omega", PAPER["hard_ground_clock"]["omega_rad_s"])
def test_the_hard_ground_clock_is_nearly_stuck(omega):
    stuck = PAPER["hard_ground_clock"]
    for phi in PHI:
        assert speed(phi, omega, "HGCS") == pytest.approx(stuck["speed_m_s"], abs=stuck["tolerance_m_s"])


def test_critical_frequency_and_speed_rise_with_a_kink():
    best = np.array([curve(phi).argmax() for phi in PHI])
    critical, largest = OMEGA[best], np.array([curve(phi).max() for phi in PHI])
    assert (np.diff(critical) >= 0).all()
    assert (np.diff(largest) > 0).all()
    kink = PHI.index(PAPER["critical"]["kink_phi"])
    for rising in (critical, largest):
        below, above = (np.polyfit(PHI[part], rising[part], 1)[0] for part in (slice(0, kink + 1), slice(kink, None)))
        assert above > 1.5 * below


@pytest.mark.parametrize("phi", PHI)
def test_performance_is_lost_at_once_above_the_kink_and_bit_by_bit_below(phi):
    v = curve(phi)
    fallen = np.flatnonzero((v <= 1.25 * PAPER["swimming"]["speed_m_s"]) & (OMEGA[v.argmax()] < OMEGA))[0]
    width = OMEGA[fallen] - OMEGA[v.argmax()]
    sharp = PAPER["critical"]["sharp_rad_s"]
    assert width <= sharp if phi > PAPER["critical"]["kink_phi"] else width > sharp


def test_steps_end_their_shrinking_where_the_paper_sees_the_transition():
    low, high = PAPER["transition"]["step_over_r"]
    for phi in PHI:
        if phi > PAPER["transition"]["above_phi"]:
            best = curve(phi).argmax()
            assert low <= np.pi * curve(phi)[best] / OMEGA[best] / ROBOT.leg_radius_m <= high


def test_another_world_is_not_the_papers():
    """Control: the demonstration's null world walks at 30 rad/s, and at 16 on ground of 0.600."""
    other = QUIET.walked_by(ROBOT)
    assert speed(0.633, 30.0, world=other) > 0.2
    assert speed(0.600, 16.0, world=other) > 0.1
