"""Output for people: colour on a terminal, and lines that fit its width."""

import os
import sys
import textwrap

WIDTH = 80
"""Columns of a terminal."""
_CODES = {"bold": "1", "good": "1;32", "open": "1;33", "bad": "1;31"}


def styled(text: str, style: str) -> str:
    """``text`` in bold, or bold and green (``good``), yellow (``open``), red (``bad``).

    Plain if standard output is not a terminal, or if NO_COLOR is set (no-color.org).
    """
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not sys.stdout.isatty():
        return text
    return f"\x1b[{_CODES[style]}m{text}\x1b[0m"


def counted(number: int, noun: str) -> str:
    """``1 cell``, ``2 cells``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def filled(text: str, indent: str = "") -> str:
    """``text`` wrapped to a terminal's width; after an ``indent``, all lines but the first get two columns more."""
    further = f"{indent}  " if indent else ""
    return textwrap.fill(
        text, WIDTH, initial_indent=indent, subsequent_indent=further, break_long_words=False, break_on_hyphens=False
    )
