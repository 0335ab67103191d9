"""The atlas of the explorer over HTTP: the figures of the selection in the address, the title's first."""

import re

import pytest
from made_up import served

from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.app import Explorer
from sandbot_model.explore.atlas_page import AtlasPage


@pytest.fixture
def client(session, trials):
    return served(AtlasPage(session, trials, {}, "my <trials>"))


@pytest.mark.slow
def test_the_page_shows_the_papers_figures_for_the_model_in_its_address(client):
    page = client.get("/atlas?effect=leg_slip&view=lock&cell=2").text
    assert "Model: simple model + leg slip." in page
    assert "my &lt;trials&gt;" in page
    pictures = re.findall(r'src="(/atlas/[^"]+)"', page)
    assert pictures[0] == "/atlas/fig1e_speed_phi.svg?effect=leg_slip"
    drawn = client.get(pictures[0])
    assert drawn.mimetype == "image/svg+xml"
    assert "<svg" in drawn.text
    assert "Fig. 1c of the paper: not drawn, two trials with bags" in page
    assert 'href="/?view=lock&amp;effect=leg_slip&amp;cell=2"' in page
    assert "by hand" not in page


def test_values_held_by_hand_are_left_out_and_the_way_back_has_them(session, trials, monkeypatch):
    monkeypatch.setattr("sandbot_model.explore.atlas_page.PLATES", ())
    page = (
        served(AtlasPage(session, trials, {}, "test")).get("/atlas?hold=delta_t_s%3D0.35&against=%3Fmodel%3Dfull").text
    )
    assert "Values held by hand are ignored here (delta_t_s = 0.35): this page shows the fit." in page
    assert 'href="/?hold=delta_t_s%3D0.35&amp;against=%3Fmodel%3Dfull"' in page


def test_another_model_gives_other_lines_and_the_same_one_the_same(client):
    first, again, other = (client.get(f"/atlas/fig2a_speed_omega.svg{query}").text for query in ("", "", "?model=full"))
    assert first == again != other


def test_there_are_no_other_pictures(client):
    assert client.get("/atlas/passwd.svg").status_code == 404


def test_the_explorers_tab_leads_there_with_its_selection(session, trials, tmp_path):
    explorer = Explorer(session, trials, [tmp_path / "trials.csv"], "test")
    session.fit_ahead = lambda selection: None
    assert explorer.show(Selection(effects=("leg_slip",)), "light")["atlas.href"] == "/atlas?effect=leg_slip"
    assert explorer.app().server.test_client().get("/atlas", base_url="http://127.0.0.1").status_code == 200
