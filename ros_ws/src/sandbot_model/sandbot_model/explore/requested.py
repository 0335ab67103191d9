"""What the address of one of the explorer's further pages asks for."""

from urllib.parse import urlencode

from flask import request

from sandbot_model.discovery.choice import Selection, from_query


def requested_selection(*others: str) -> Selection:
    """Everything the address says, so that the links of a page lead back to the very same state.

    ``others`` are keys of the page's own. Raises InputError.
    """
    return from_query(f"?{urlencode([pair for pair in request.args.items(multi=True) if pair[0] not in others])}")


def model_only(asked: Selection) -> Selection:
    """The model asked for, with nothing held and nothing of what is looked at: what a page of fits draws."""
    return Selection(asked.model, asked.effects, asked.formulas)


def held_values(asked: Selection) -> str:
    """What is held by hand, and at which values; empty if nothing is."""
    return ", ".join(f"{name} = {value:.5g}" for name, value in asked.by_hand)


def held_values_note(asked: Selection) -> str:
    """A sentence on the values held by hand, for a page that shows the fit without them; empty if there are none."""
    held = held_values(asked)
    return f"Values held by hand are left out ({held}): this page shows the fit." if held else ""
