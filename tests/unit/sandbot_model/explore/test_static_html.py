"""Dash's elements as HTML that nobody watches."""

from html.parser import HTMLParser

from dash import html
from hypothesis import given
from hypothesis import strategies as st

from sandbot_model.discovery.selection import Selection
from sandbot_model.explore.app import Explorer
from sandbot_model.explore.static_html import static, to_html


class Read(HTMLParser):
    """What a browser would make of it: (tag, attributes) and words, in order."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words = [], ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words += data


# A parser of HTML makes a line feed of a carriage return.
TEXT = st.text(st.characters(exclude_categories=["Cc", "Cs"]))


@given(TEXT, TEXT)
def test_words_and_attributes_come_through_as_they_are(words, title):
    read = Read(to_html(html.P([words, None, html.B(1)], title=title, className="soft")))
    assert read.tags == [("p", {"title": title, "class": "soft"}), ("b", {})]
    assert read.words == f"{words}1"


def test_what_is_html_already_stays_and_void_elements_have_no_end():
    assert to_html([html.Br(), html.Img(alt=""), html.Span(**{"data-html": "<math/>"})]) == (
        '<br><img alt=""><span><math/></span>'
    )
    assert static(html.B("<i>"), className="x").to_plotly_json()["props"] == {
        "children": None,
        "className": "x", "data-html": "<b>&lt;i&gt;</b>",
    }  # fmt: skip


def elements(part):
    """How many elements Dash watches."""
    if isinstance(part, list | tuple):
        return sum(map(elements, part))
    if isinstance(part, dict):
        return elements(list(part.values()))
    if not hasattr(part, "_prop_names"):
        return 0
    return 1 + elements([getattr(part, name, None) for name in part._prop_names])


def test_a_click_does_not_ask_hundreds_of_elements(session, trials, tmp_path):
    """The page had 324 of them, its effects 138 more: nine tenths of the time of a click went there."""
    explorer = Explorer(session, trials, [tmp_path / "x.csv"], "test")
    listed = explorer.show(Selection(), "light")["effects.options"]
    assert len(listed) > 20
    assert elements(listed) == len(listed)
    assert 40 < elements(explorer.app().layout) < 120
