"""All available effects: the project's, those of installed packages, of a user's file, and formulas."""

import contextlib
import importlib.util
import pickle
import re
import sys
import zlib
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common.errors import InputError
from sandbot_model.physics import effect as effect_module
from sandbot_model.physics.effect import REPLACEABLE, STAGES, Effect, Parameter, duplicate_name, is_range
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.first_run import changes_something, is_repeatable, vanishes
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.typeset import mathml
from sandbot_model.physics.walking import Inputs, Walker

GROUP = "sandbot_model.effects"
"""Entry-point group: each entry names an Effect subclass."""
ARRAYS = "quantities and parameters are arrays, of all conditions at once: np.where and np.exp, not if, float and math"
"""Hint for an effect that treats an array as a number."""
USER_MODULE = "sandbot_user_effects_"
"""Prefix of the module names of users' files; other processes cannot import them by name."""


def catalogue(files: Sequence[Path] = (), formulas: Sequence[str] = ()) -> dict[str, Effect]:
    """All effects by identifier, in order. Raises InputError for a file or formula that is no effect."""
    effects = {effect.identifier: effect for effect in CATALOGUE}
    for entry in entry_points(group=GROUP):
        _add(effects, [_instance(_loaded(entry), f"entry point {entry.name}")], f"entry point {entry.name}")
    for path in files:
        _add(effects, effects_in(path), str(path))
    for text in formulas:
        _add(effects, [formula_effect(text)], f"--effect {text!r}")
    return effects


def _loaded(entry: EntryPoint) -> Any:
    """The object that a plug-in's entry point names. Raises InputError if it can't be imported for any reason."""
    try:
        return entry.load()
    except Exception as error:
        raise InputError(f"entry point {entry.name}: can't be loaded: {_one_line(error)}") from error


def effects_in(path: Path) -> list[Effect]:
    """One instance of each Effect subclass defined in a Python file."""
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder, a Python file is needed' if path.is_dir() else 'no such file'}")
    spec = importlib.util.spec_from_file_location(_module_name(path), path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    # Worker processes find its classes by this name.
    sys.modules[spec.name] = module
    # Files written for 0.1 import from sandbot_model.chain.
    sys.modules.setdefault("sandbot_model.chain", effect_module)
    # Leave no __pycache__ in the user's folder.
    usual, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        # What the file prints is no part of the answer.
        with contextlib.redirect_stdout(sys.stderr):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: {_one_line(error)}") from error
    finally:
        sys.dont_write_bytecode = usual
    classes = [cls for cls in vars(module).values() if isinstance(cls, type) and cls.__module__ == module.__name__]
    found = [_instance(cls, str(path)) for cls in classes if issubclass(cls, Effect)]
    if not found:
        raise InputError(f"{path}: no subclass of sandbot_model.Effect in it")
    return found


def _module_name(path: Path) -> str:
    """A unique module name: workers find its classes by it, and other folders may have files of the same name."""
    stem, folder = re.sub(r"\W", "_", path.stem), zlib.crc32(str(path.resolve()).encode())
    return f"{USER_MODULE}{stem}_{folder:08x}"


def _instance(cls: object, where: str) -> Effect:
    if not (isinstance(cls, type) and issubclass(cls, Effect)):
        raise InputError(f"{where}: {cls!r} is not a subclass of sandbot_model.Effect")
    for name in ("identifier", "stage", "formula", "source", "seen_in"):
        if not isinstance(getattr(cls, name, None), str):
            raise InputError(f"{where}: {cls.__name__} has no {name}")
    if not isinstance(cls.control, str):
        raise InputError(f"{where}: {cls.__name__}: control is {cls.control!r}, it may be an experiment in words")
    if cls.apply is Effect.apply:
        raise InputError(f"{where}: {cls.__name__} has no apply")
    if cls.stage not in STAGES:
        raise InputError(f"{where}: {cls.__name__}: stage {cls.stage!r} is not one of {', '.join(STAGES)}")
    try:
        effect = cls()
    except Exception as error:
        raise InputError(f"{where}: {cls.__name__}: {_one_line(error)}") from error
    _check_parameters(effect, where)
    _try(effect, where)
    return effect


def _check_parameters(effect: Effect, where: str) -> None:
    if not isinstance(effect.parameters, tuple):
        raise InputError(f"{where}: {type(effect).__name__}: parameters is not a tuple; is a comma missing?")
    for parameter in effect.parameters:
        if not isinstance(parameter, Parameter):
            raise InputError(f"{where}: {type(effect).__name__}: parameters holds {parameter!r}, expected a Parameter")
        numbers = low, start, high = parameter.low, parameter.start, parameter.high
        known = all(isinstance(value, int | float) and np.isfinite(value) for value in numbers)
        if not (known and is_range(low, high)):
            raise InputError(
                f"{where}: {parameter.name}: from {low!r} to {high!r} is not a range, low < high is needed"
            )
        if not low <= start <= high:
            raise InputError(f"{where}: {parameter.name}: start {start!r} is not within {low!r} to {high!r}")
    if twice := duplicate_name(effect.parameters):
        raise InputError(f"{where}: {type(effect).__name__}: parameter {twice!r} is declared twice")
    if not (isinstance(effect.replaces, tuple) and set(effect.replaces) <= set(REPLACEABLE)):
        can = ", ".join(map(repr, REPLACEABLE))
        raise InputError(f"{where}: {type(effect).__name__}: replaces is {effect.replaces!r}, it may be () or ({can},)")


def _try(effect: Effect, where: str) -> None:
    """Run and pickle the effect, so that mistakes show before any fit."""
    place = f"{where}: {type(effect).__name__}.apply"
    values = {parameter.name: np.asarray(parameter.start, dtype=float) for parameter in effect.parameters}
    walker, inputs = Walker((effect,)), Inputs(200.0, 8.0, 0.4, 0.61)
    try:
        with np.errstate(all="ignore"):
            acts, same, gone = changes_something(effect), is_repeatable(effect), vanishes(effect)
            walker.predict(inputs, [values])
            filled = walker.chain(inputs, [values], np.array([0.03, 0.04]), first_step=False)
            finite = all(np.isfinite(part).all() for part in (filled.margin, filled.speed, filled.peak_ratio))
    except Exception as error:
        more = f"; {ARRAYS}" if isinstance(error, TypeError | ValueError) else ""
        raise InputError(f"{place}: {_one_line(error)}{more}") from error
    if not finite:
        raise InputError(f"{place}: gives no finite number at the start values of its parameters")
    if not acts:
        raise InputError(f"{place}: changes nothing that is seen; a quantity is changed by setting it, chain.k = ...")
    if not same:
        raise InputError(f"{place}: gives another result for the same inputs; it may depend on nothing else")
    if not gone:
        neutral = ", ".join(f"{parameter.name} = {parameter.neutral:g}" for parameter in effect.parameters)
        raise InputError(f"{place}: changes something at its neutral value, {neutral}, where it must vanish")
    try:
        pickle.dumps(effect)
    except Exception as error:
        raise InputError(
            f"{where}: {type(effect).__name__}: can't be sent to worker processes: {_one_line(error)}; keep functions "
            "and locks at the top of the file, not in the effect"
        ) from error


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _add(catalogue: dict[str, Effect], effects: Iterable[Effect], where: str) -> None:
    for effect in effects:
        if effect.identifier in catalogue:
            raise InputError(f"{where}: there is an effect {effect.identifier!r} already")
        catalogue[effect.identifier] = effect


def describe(effects: Mapping[str, Effect]) -> list[dict[str, object]]:
    """The catalogue as plain data, for tables and JSON."""
    return [
        {
            "effect": effect.identifier,
            "stage": effect.stage,
            "formula": effect.formula,
            "typeset": mathml(effect.formula),
            "parameters": [
                {
                    "name": parameter.name,
                    "unit": parameter.unit,
                    "low": parameter.low,
                    "high": parameter.high,
                    "start": parameter.start,
                    "doc": parameter.doc,
                }
                for parameter in effect.parameters
            ],
            "seen_in": effect.seen_in,
            "control": effect.control,
            "source": effect.source,
        }
        for effect in effects.values()
    ]
