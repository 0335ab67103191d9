"""A gain where the catalogue has a loss is no other effect's, however well one of its conventions fits."""

import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.physics.catalogue import catalogue

FEW = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "bed_slope")}


@pytest.mark.parametrize(
    ("formula", "status"),
    [
        ("o: speed: kept *= 1 + 0.1", "unexplained"),
        # Control: of the catalogue's sign, under another convention.
        ("o: speed: kept *= 1 - 0.1*(1 - first)", "identified"),
    ],
)
def test_a_claim_that_the_other_sign_equals_is_refused(drawn, formula, status):
    found = discover(
        cells_of(drawn(formulas=(formula,), seed=5, levels=3, omega=(4, 8, 12, 16, 24))), FEW, max_effects=1
    )
    assert found.verdict.status == status
    refused = "stance_overlap.eta = -0.1" in found.verdict.because
    assert refused == (status == "unexplained")
    assert not refused or "of a sign that stance_overlap can't have, fits as well" in found.verdict.because
