"""The one exception a user is meant to see."""


class InputError(ValueError):
    """What was given can't be used. ``str(error)`` is one line: where, which value, what would be right."""
