"""What goes wrong in a worker comes back as what it is: an error that can't takes the whole pool along."""

import pickle
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from sandbot_bed.protocol import PreparationFailed, PulseProtocol
from sandbot_common.errors import InputError

PACKAGES = [str(path) for path in (Path(__file__).parents[3] / "ros_ws" / "src").glob("sandbot_*")]
MADE_OF = {PreparationFailed: PulseProtocol().command}
"""What an exception is made of, where that is not its line."""


def descendants(cls: type) -> Iterator[type]:
    for child in cls.__subclasses__():
        yield child
        yield from descendants(child)


def test_every_exception_comes_back_from_a_worker():
    for module in pkgutil.walk_packages(PACKAGES):
        if module.name != "setup":
            import_module(module.name)
    ours = [one for one in set(descendants(Exception)) if one.__module__.startswith("sandbot_")]
    assert {InputError, PreparationFailed} < set(ours)
    for cls in ours:
        error = cls(MADE_OF.get(cls, "a.csv: row 3"))
        back = pickle.loads(pickle.dumps(error))
        assert (type(back), str(back), repr(vars(back))) == (cls, str(error), repr(vars(error)))
