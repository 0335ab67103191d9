"""What the address of one of the explorer's further pages asks for."""

from urllib.parse import urlencode

from flask import request

from sandbot_model.discovery.choice import Selection, from_query


def asked_selection(*others: str) -> Selection:
    """The model asked for: a cell or a view of the explorer's page changes nothing here, nor do keys in ``others``.

    Raises InputError.
    """
    asked = from_query(f"?{urlencode([pair for pair in request.args.items(multi=True) if pair[0] not in others])}")
    return Selection(asked.model, asked.effects, asked.formulas)
