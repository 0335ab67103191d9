"""The one exception a user is meant to see."""


class InputError(ValueError):
    """Unusable input. ``str(error)`` is one line: where, which value, what would be right."""
