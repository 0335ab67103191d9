"""What a misspelt name may have meant."""

import difflib
from collections.abc import Iterable

_CUTOFF = 0.65
"""Least similarity of a slip: one letter of three may be wrong. difflib's 0.6 finds "eta" in ``delta_t_s``."""
_MOST = 30
"""Most names listed; a campaign may have hundreds of trials."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of an error about ``name``: the nearest of the ``known`` names, or the first of them.

    Spaces, hyphens, underscores, capitals and .yaml are ignored: "Leg slip" means ``leg_slip``.
    """
    names = list(known)
    close = near(name, names)
    more = f", ... ({len(names)} in all)" if len(names) > _MOST else ""
    return f", did you mean {close!r}?" if close else f"; known: {', '.join(names[:_MOST]) or 'none'}{more}"


def near(name: str, known: Iterable[str]) -> str:
    """The ``known`` name whose last part is ``name``, or that is most similar to it; empty if there is none."""
    plain = {_plain(candidate): candidate for candidate in known}
    if ends := [candidate for candidate in plain if candidate.endswith(f".{_plain(name)}")]:
        return plain[ends[0]]
    close = difflib.get_close_matches(_plain(name), plain, n=1, cutoff=_CUTOFF)
    return plain[close[0]] if close else ""


def _plain(name: str) -> str:
    return name.strip().lower().removesuffix(".yaml").replace(" ", "").replace("-", "").replace("_", "")
