"""Which effects there are: those of the project, those of installed packages, a user's file, a formula."""

import importlib.util
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path

from sandbot_common.errors import InputError
from sandbot_model.chain import STAGES, Effect
from sandbot_model.effects import CATALOGUE
from sandbot_model.formula import formula_effect

GROUP = "sandbot_model.effects"
"""Entry-point group: each entry names an Effect subclass."""
USER_MODULE = "sandbot_user_effects_"
"""How the modules of users' files are named; no other process can import them."""


def catalogue(files: Sequence[Path] = (), formulas: Sequence[str] = ()) -> dict[str, Effect]:
    """All effects by identifier, in order. Raises InputError for a file or formula that is no effect."""
    known = {effect.identifier: effect for effect in CATALOGUE}
    for entry in entry_points(group=GROUP):
        _add(known, [_made(entry.load(), f"entry point {entry.name}")], f"entry point {entry.name}")
    for path in files:
        _add(known, effects_in(path), str(path))
    for text in formulas:
        _add(known, [formula_effect(text)], f"--effect {text!r}")
    return known


def effects_in(path: Path) -> list[Effect]:
    """One instance of each Effect subclass defined in a Python file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    spec = importlib.util.spec_from_file_location(f"{USER_MODULE}{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    # Workers find its classes by name.
    sys.modules[spec.name] = module
    # The folder is the user's: no __pycache__ is left in it.
    usual, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    finally:
        sys.dont_write_bytecode = usual
    classes = [one for one in vars(module).values() if isinstance(one, type) and one.__module__ == module.__name__]
    found = [_made(one, str(path)) for one in classes if issubclass(one, Effect)]
    if not found:
        raise InputError(f"{path}: no subclass of sandbot_model.chain.Effect in it")
    return found


def _made(cls: object, where: str) -> Effect:
    if not (isinstance(cls, type) and issubclass(cls, Effect)):
        raise InputError(f"{where}: {cls!r} is not a subclass of sandbot_model.chain.Effect")
    for name in ("identifier", "stage", "formula", "source", "seen_in"):
        if not isinstance(getattr(cls, name, None), str):
            raise InputError(f"{where}: {cls.__name__} has no {name}")
    if cls.stage not in STAGES:
        raise InputError(f"{where}: {cls.__name__}: stage {cls.stage!r} is not one of {', '.join(STAGES)}")
    return cls()


def _add(known: dict[str, Effect], effects: Iterable[Effect], where: str) -> None:
    for effect in effects:
        if effect.identifier in known:
            raise InputError(f"{where}: there is an effect {effect.identifier!r} already")
        known[effect.identifier] = effect


def describe(effects: Mapping[str, Effect]) -> list[dict[str, object]]:
    """The catalogue as plain data, for tables and JSON."""
    return [
        {
            "effect": effect.identifier,
            "stage": effect.stage,
            "formula": effect.formula,
            "parameters": [
                {
                    "name": one.name,
                    "unit": one.unit,
                    "low": one.low,
                    "high": one.high,
                    "start": one.start,
                    "doc": one.doc,
                }
                for one in effect.parameters
            ],
            "seen_in": effect.seen_in,
            "source": effect.source,
        }
        for effect in effects.values()
    ]
