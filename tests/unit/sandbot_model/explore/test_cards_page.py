"""Effects as cards: what helps comes first, the rest is folded, each has its switch, and one's own has no drawing."""

import math
import re
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import BOOST, served

from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore.cards_page import CardsPage
from sandbot_model.explore.previews import change_of, delta_bic, folded, helps, ordered
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.formula import formula_effect
from sandbot_model.report.captions import HOW_TO_READ, PERFECT
from sandbot_model.report.drawings import MOTIFS, drawing

pytestmark = pytest.mark.slow  # together seconds

NAMES = [effect.identifier for effect in CATALOGUE]
PREVIEWS = st.one_of(st.none(), st.tuples(st.floats(0, 1), st.floats(0, 1e3) | st.just(math.nan)))


@pytest.fixture(scope="module")
def client(session):
    return served(CardsPage(session, "my <trials>"))


def test_every_effect_of_the_catalogue_has_a_drawing_of_its_own_and_no_other_name_has():
    assert list(MOTIFS) == NAMES
    drawn = [drawing(name) for name in NAMES]
    assert len(set(drawn)) == len(NAMES)
    for one in drawn:
        assert ElementTree.fromstring(one).attrib["viewBox"] == "0 0 160 100"
        assert "prefers-color-scheme: dark" in one
        assert 'class="new' in one or "newgrain" in one
    assert drawing("boost") is None


def test_a_card_says_what_an_effect_is_and_switches_it(client, session):
    page = client.get("/effects?view=lock").text
    error, _ = session.previews(Selection())["leg_slip"]
    now = session.step(Selection()).fit.rmse_m_s
    card = re.search(r'<article class="card" id="leg_slip".*?</article>', page, re.DOTALL)[0]
    assert f"{100 * now:.2f} → {100 * error:.2f} cm/s" in card
    assert f"cm/s, {PERFECT}." in page
    assert PERFECT in HOW_TO_READ["ladder"]
    assert "no model can" not in page + HOW_TO_READ["ladder"]  # in sample a fit is slightly below the floor
    assert 'href="/?view=lock&amp;effect=leg_slip">Switch on leg slip' in card
    assert "slip at depth d_r" in card
    assert "<math>" in card
    assert 'src="/drawing/leg_slip.svg"' in card
    assert "my &lt;trials&gt;" in page
    on = client.get("/effects?effect=leg_slip&effect=cohesion").text
    assert 'href="/?effect=cohesion">Switch off leg slip' in on


def test_a_switch_keeps_what_the_page_shows_and_holds(client):
    page = client.get("/effects?view=lock&effect=cohesion&hold=delta_t_s%3D0.35").text
    assert 'href="/?view=lock&amp;effect=cohesion&amp;hold=delta_t_s%3D0.35">Back' in page
    assert 'href="/?view=lock&amp;hold=delta_t_s%3D0.35">Switch off cohesion' in page
    assert "Values held by hand are ignored here (delta_t_s = 0.35): this page shows the fit." in page


def test_what_does_not_help_is_folded_and_what_is_on_is_not(client, session):
    on = Selection(effects=("cohesion",))
    now = session.step(on).fit.bic
    shown, hidden = client.get("/effects?effect=cohesion").text.split("<details class='rest'>")
    for name, preview in session.previews(on).items():
        useful = name == "cohesion" or helps(preview, now)
        assert (f'<article class="card" id="{name}"' in shown) == useful
        assert (f'<article class="card" id="{name}"' in hidden) != useful


def test_an_effect_of_ones_own_has_a_card_without_a_drawing(client):
    query = to_query(Selection(formulas=(BOOST,)))
    page = client.get(f"/effects{query}").text
    card = re.search(r'<article class="card" id="boost".*?</article>', page, re.DOTALL)[0]
    assert "/drawing/" not in card
    assert client.get("/drawing/boost.svg").status_code == 404
    address = re.search(r'src="(/effects/boost/fingerprint.svg[^"]+)"', card)[1]
    assert client.get(address.replace("&amp;", "&")).status_code == 200


def test_a_fingerprint_is_drawn_where_the_effect_would_show(client):
    picture = client.get("/effects/stance_overlap/fingerprint.svg").text
    ElementTree.fromstring(picture)
    assert 'class="frame"' in picture
    nothing = client.get("/effects/added_mass/fingerprint.svg").text
    assert '<rect class="frame"' not in nothing
    assert client.get("/effects/levitation/fingerprint.svg").status_code == 404


@given(st.dictionaries(st.text(min_size=1), PREVIEWS), st.data())
def test_the_order_loses_nothing_and_puts_what_helps_most_first(previews, data):
    on = data.draw(st.lists(st.sampled_from(sorted(previews)), unique=True)) if previews else []
    names = ordered(previews, on)
    assert sorted(names) == sorted(previews)
    if any(preview is None for preview in previews.values()):
        assert names == list(previews)
        return
    assert set(names[: len(on)]) == set(on)
    bics = [bic for _, bic in (previews[name] for name in names[len(on) :]) if math.isfinite(bic)]
    assert bics == sorted(bics)
    assert not any(math.isnan(previews[name][1]) for name in names[len(on) : len(on) + len(bics)])


def test_the_change_is_told_from_before_to_after_and_whether_it_helps():
    assert change_of((0.01, 0.02), False, 0.03) == "3.00 → 1.00 cm/s"
    assert change_of((0.03, 0.02), True, 0.01) == "3.00 → 1.00 cm/s"
    assert change_of(None, False, 0.01) == "…"
    assert change_of((math.nan, math.nan), False, 0.01) == "no fit"
    assert change_of((math.nan, 12.0), False, math.nan) == "–"
    assert delta_bic((0.01, 150.0), False, 200.0) == "ΔBIC −50"
    assert delta_bic((0.01, 250.0), True, 200.0) == "ΔBIC −50"
    assert delta_bic(None, False, 200.0) == delta_bic((math.nan, math.nan), False, 200.0) == ""
    assert helps(None, 200.0)
    assert helps((0.01, 199.0), 200.0)
    assert not helps((0.009, 201.0), 200.0)
    assert not helps((math.nan, math.nan), 200.0)


def test_an_effect_of_ones_own_is_never_folded():
    now = SimpleNamespace(effects=("cohesion",), bic=200.0)
    own, slip, on = formula_effect(BOOST), catalogue()["leg_slip"], catalogue()["cohesion"]
    worse = (0.01, 201.0)
    assert [folded(effect, worse, now) for effect in (own, slip, on)] == [False, True, False]
    assert not folded(slip, (0.01, 199.0), now)
