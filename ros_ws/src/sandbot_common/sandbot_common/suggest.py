"""What a misspelt name may have meant."""

import difflib
from collections.abc import Iterable


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of a complaint about ``name``: the nearest of the ``known`` names, or all of them.

    Spaces, hyphens and capitals count for nothing: "Leg slip" means ``leg_slip``.
    """
    names = list(known)
    close = near(name, names)
    return f", did you mean {close!r}?" if close else f"; known: {', '.join(names)}"


def near(name: str, known: Iterable[str]) -> str:
    """The one of the ``known`` names most like ``name``, or of which that is the last part; empty if none is."""
    plain = {_plain(one): one for one in known}
    if ends := [one for one in plain if one.endswith(f".{_plain(name)}")]:
        return plain[ends[0]]
    close = difflib.get_close_matches(_plain(name), plain, n=1)
    return plain[close[0]] if close else ""


def _plain(name: str) -> str:
    return name.strip().lower().replace(" ", "").replace("-", "").replace("_", "")
