"""The page itself: sections of figures, tables and pictures in one HTML file that needs no network."""

import base64
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from sandbot_common.files import write_text
from sandbot_model.report.theme import THEMES, Spec, Theme


@dataclass(frozen=True)
class Figure:
    """A figure of the page: one spec per step of the ladder (or a single one) in each theme."""

    name: str
    alt: tuple[str, ...]
    """Text alternative for readers who can't see it: one per step of the ladder, or a single one."""
    caption: str
    draw: Callable[[Theme], list[Spec]]

    @property
    def height(self) -> int:
        """Height in px, reserved so that the page does not jump while figures are drawn."""
        return int(self.draw(THEMES["light"])[0]["layout"]["height"])


@dataclass(frozen=True)
class Table:
    """A table; ``words`` flags the columns that are text (the rest are numbers, right-aligned).

    A cell of ``Markup`` (a formula) is inserted verbatim; all others are escaped.
    """

    caption: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    words: tuple[bool, ...]
    step: int | None = None
    """The step of the ladder with which it is shown; None: always."""
    folded: bool = False


@dataclass(frozen=True)
class Download:
    """A file embedded in the page."""

    name: str
    label: str
    href: str


@dataclass(frozen=True)
class Picture:
    """A drawing or a video frame; a ``wide`` one spans both columns of the page."""

    source: str
    caption: str
    wide: bool = False


@dataclass(frozen=True)
class Section:
    """One heading and its content."""

    id: str
    heading: str
    text: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    downloads: tuple[Download, ...] = ()


@dataclass(frozen=True)
class NamedEffect:
    """An effect that a verdict names."""

    name: str
    words: str
    parameters: tuple[str, ...] = ()
    picture: str = ""
    """Data URI of its drawing."""


@dataclass(frozen=True)
class Page:
    """Everything on the page, in reading order."""

    title: str
    kind: str
    headline: tuple[tuple[str, str, str], ...]
    """(term, value, meaning)."""
    sections: tuple[Section, ...]
    status: str = ""
    sentence: str = ""
    why: str = ""
    """The reason for the sentence, folded below it."""
    named: tuple[tuple[str, tuple[NamedEffect, ...]], ...] = ()
    """(heading, effects) of each set of effects that the verdict names; the heading is empty where there is one set."""
    cautions: tuple[tuple[str, str], ...] = ()
    steps: tuple[tuple[str, str], ...] = field(default=())
    """(label, error) of each selectable model: the steps of the ladder, or rivals."""
    opened: int = -1
    """Index of the model shown first."""
    back: str = ""
    """Address of the page to return to."""


def write(path: Path, page: Page) -> None:
    """Render ``page`` to ``path``, atomically."""
    write_text(path, render(page))


def render(page: Page) -> str:
    """The page as one HTML document with plotly.js, data and style inside."""
    figures = {
        figure.name: {name: figure.draw(theme) for name, theme in THEMES.items()}
        for section in page.sections
        for figure in section.figures
    }
    return _template().render(
        page=page,
        style=Markup(source("report.css")),
        export=Markup(source("export.js")),
        script=Markup(source("report.js")),
        plotlyjs=Markup(get_plotlyjs().replace("</script", "<\\/script")),
        figures=Markup(for_script(figures)),
    )


def for_script(value: object) -> str:
    """JSON safe inside a script element: no string in it can open or close a tag."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def data_uri(content: bytes, kind: str) -> str:
    """``content`` as a data URI of media type ``kind``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def source(name: str) -> str:
    """The content of a text file of this package."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(source("report.html.j2"))
