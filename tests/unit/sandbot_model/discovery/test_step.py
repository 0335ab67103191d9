"""One effect more: near a fit that leaves nothing to explain, anywhere beside another."""

import pytest

from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery import step
from sandbot_model.discovery.step import Begin
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of

EFFECTS = catalogue()


@pytest.mark.parametrize(("planted", "nearby"), [((), True), (("stance_overlap",), False)])
def test_a_search_stays_near_where_nothing_is_left_to_explain(drawn, monkeypatch, planted, nearby):
    cells = cells_of(drawn(planted, seed=3, levels=3))
    base, more = fit(model_of("simple", (), EFFECTS), cells), model_of("simple", ("stance_overlap",), EFFECTS)
    begin = Begin.after(base)
    assert begin.nearby == nearby
    found = begin.fit(more, cells)
    assert found.deviance <= base.deviance + 1.0
    assert found.deviance == pytest.approx(fit(more, cells, base.warm_start).deviance, abs=0.5)
    # Control: only the other kind of search goes everywhere.
    monkeypatch.setattr(step, "fit", None)
    if nearby:
        assert begin.fit(more, cells).deviance == found.deviance
    else:
        with pytest.raises(TypeError):
            begin.fit(more, cells)


def test_searches_are_the_same_where_they_begin_at_the_same_place_and_look_as_far(drawn):
    base = fit(model_of("simple", (), EFFECTS), cells_of(drawn(levels=3)))
    begin = Begin.after(base)
    assert begin.same_as(Begin(base.warm_start, begin.nearby))
    assert Begin.after(None).same_as(Begin(None))
    for other in (None, Begin(None), Begin(base.warm_start, not begin.nearby)):
        assert not begin.same_as(other)
