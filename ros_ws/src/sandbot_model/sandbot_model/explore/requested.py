"""The selection requested by the address of one of the explorer's further pages."""

from urllib.parse import urlencode

from flask import request

from sandbot_model.discovery.choice import Selection, from_query


def requested_selection(*others: str) -> Selection:
    """The complete selection in the address, so that links back restore the same state.

    ``others`` are keys specific to the page. Raises InputError.
    """
    return from_query(f"?{urlencode([pair for pair in request.args.items(multi=True) if pair[0] not in others])}")


def model_only(asked: Selection) -> Selection:
    """Only the model requested, without values held by hand and without view, for pages that show fits."""
    return Selection(asked.model, asked.effects, asked.formulas)


def held_values(asked: Selection) -> str:
    """The parameters held by hand with their values, as text; empty if there are none."""
    return ", ".join(f"{name} = {value:.5g}" for name, value in asked.by_hand)


def held_values_note(asked: Selection) -> str:
    """A note that a page of fits ignores the values held by hand; empty if there are none."""
    held = held_values(asked)
    return f"Values held by hand are ignored here ({held}): this page shows the fit." if held else ""
