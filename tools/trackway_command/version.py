"""Which trackway this is."""

from importlib.metadata import version as of_package


def version() -> str:
    """The version, and the commit where this is a checkout; ``not built`` before the workspace is."""
    try:
        from sandbot_bringup.provenance import commit

        return f"{of_package('sandbot_bringup')}, commit {commit()}"
    except ModuleNotFoundError:
        return "not built"
