"""Where effects would show: those whose k(φ) or average along the track is the whole of it, too."""

import pytest

from sandbot_model.discovery.fingerprint import SEEN, fingerprint
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.observables import Observable


@pytest.mark.parametrize(
    ("text", "shows"),
    [
        ("patchy: strength: sigma = hypot(sigma, a); a in 0.003..0.005", True),
        ("patchy: strength: sigma = hypot(sigma, a); a in 0..0.0001", False),
        ("denser: strength: k + (K(phi + a) - k)*first; a in 0.01..0.02", True),
        ("denser: strength: k + (K(phi + a) - k)*first; a in 0..0.0001", False),
    ],
)
def test_what_hangs_on_k_of_phi_shows_where_it_is_strong(text, shows):
    effects = catalogue(formulas=[text])
    found = fingerprint(effects[text.partition(":")[0]], effects)
    assert (max(abs(found.largest(one)[0]) for one in Observable) > SEEN) == shows
