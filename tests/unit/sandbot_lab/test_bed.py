"""The bed packs with pulses, loosens when fluidised, and its height tells the volume fraction."""

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_lab.bed import LabBed, LabBedParameters


def blow(bed, seconds, level=0.6):
    bed.set_blower(level)
    bed.advance(seconds)
    bed.set_blower(0.0)
    bed.advance(1.0)


def test_fluidise_then_ramp_down_leaves_loose_ground():
    bed = LabBed(seed=1, phi=0.62)
    for level in (1.0, 0.7, 0.4, 0.1):
        bed.set_blower(level)
        bed.advance(1.0)
    assert bed.phi == 0.62  # still fluidised
    bed.set_blower(0.0)
    assert bed.phi == pytest.approx(0.580, abs=0.002)


def test_pulses_pack_towards_close():
    bed = LabBed(seed=1, phi=0.580)
    phis = []
    for _ in range(200):
        blow(bed, 0.1)
        phis.append(bed.phi)
    assert (np.diff(phis) > 0).all()
    assert phis[24] == pytest.approx(0.580 + 0.053 * (1 - np.exp(-1)), abs=0.004)
    assert 0.6325 < phis[-1] < 0.633


def test_longer_pulses_pack_more_and_no_two_beds_alike():
    short, long, other = LabBed(3, phi=0.58), LabBed(3, phi=0.58), LabBed(4, phi=0.58)
    for bed, seconds in ((short, 0.05), (long, 0.2), (other, 0.05)):
        blow(bed, seconds)
    assert long.phi > short.phi
    assert other.phi != short.phi


def test_height_gives_the_volume_fraction():
    bed, p = LabBed(seed=2, phi=0.61), LabBedParameters()
    heights = np.array([bed.read_height_m() for _ in range(400)])
    assert heights.std() == pytest.approx(p.sensor_sd_m, rel=0.15)
    assert p.mass_kg / (p.grain_density_kg_m3 * p.area_m2 * heights.mean()) == pytest.approx(0.61, abs=1e-4)


def test_refusals():
    bed = LabBed(seed=1)
    for level in (-0.1, 1.1, float("nan")):
        with pytest.raises(InputError, match="blower"):
            bed.set_blower(level)
    with pytest.raises(InputError, match="time step"):
        bed.advance(-1.0)
    assert 0.58 <= bed.phi <= 0.633
