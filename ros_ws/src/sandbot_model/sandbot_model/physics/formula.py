"""An effect from a line of text: ``"boost: strength: k*(1 + a*(omega/12 - 1)); a [1] in -1..1"``.

The expression gives the new value of the stage's quantity (``k``, ``force``, ``step``, ``kept`` or ``omega``), or of
another one that is named: ``"brake: balance: extra_force = c*omega; c [N s] in 0..0.1"`` (``->`` means the
same as ``=``). ``*=``, ``/=``, ``+=`` and ``-=`` change the present value, also of several quantities at once:
``"slip: speed: kept, peak *= 1 - a*d/R; a [1] in 0..1"``. Further statements are applied in turn:
``"slip: step: s *= 1 - a; peak *= 1 - a/2; a [1] in 0..1"``.

Names are the symbols that the catalogue shows (see ``symbols``: quantities of the chain, the robot's R, h, w, m, g, …),
the parameters, ``first`` (1 in the first step, on virgin ground, 0 in all others), K(phi), and functions; a parameter
may hide another symbol, but not one that is set. asteval evaluates the expression: no attributes, imports or files.
"""

import ast
import re
import threading
from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

import asteval
import numpy as np

from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.suggest import did_you_mean, near
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import STAGES, Effect, Parameter, Values, duplicate_name, is_range
from sandbot_model.physics.first_run import changes_something
from sandbot_model.physics.symbols import CONSTANTS, get, put, readable, settable, stage_of
from sandbot_model.physics.syntax import tree
from sandbot_model.physics.walking import Inputs, Walker

MAIN = {"clock": "omega", "strength": "k", "balance": "force", "step": "step", "speed": "kept"}
"""What a bare expression sets at each stage."""

FUNCTIONS = {
    **dict.fromkeys(("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"), 1),
    **dict.fromkeys(("exp", "log", "log10", "sqrt", "abs", "sign", "floor"), 1),
    **dict.fromkeys(("arctan2", "minimum", "maximum", "hypot"), 2),
    **dict.fromkeys(("clip", "where"), 3),
}
"""numpy functions an expression may use, and their numbers of arguments: one more would be numpy's ``out``."""
SHORT = {"max": "maximum", "min": "minimum", "asin": "arcsin", "acos": "arccos", "atan": "arctan"}
"""Shorter names of some of them, used by the catalogue."""
_AS_TYPED = str.maketrans({"^": "**", "−": "-", "·": "*", "×": "*", "²": "**2", "³": "**3"})

GIVEN = "given on the command line"
"""The source of an effect that is a line of text."""
FORM = "name: stage: formula; parameter [unit] in low..high; ..."
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PARAMETER = re.compile(rf"\s*([A-Za-z_]\w*)\s*(?:\[([^\]]*)\])?\s+in\s+({_NUMBER})\s*\.\.\s*({_NUMBER})\s*")
_ASSIGNMENT = re.compile(r"\s*([^\W\d]\w*(?:\s*,\s*[^\W\d]\w*)*)\s*(?:([*/+-]?)=(?!=)|->|→)\s*(.*)")
DIFFERS_AT_FIRST = {"first", "t_left"}
"""Names with another value in the first step."""
_ALWAYS = {*FUNCTIONS, *SHORT, "pi", "first", "K"}
TAKEN = {*(field.name for field in fields(Chain)), *"RhwmgdK", *_ALWAYS}
"""Names that no parameter can have."""
_CHANGES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "*": np.multiply,
    "/": np.divide,
    "+": np.add,
    "-": np.subtract,
    "": lambda old, new: _broadcast_like(old, new),
}
_TAKES = {**FUNCTIONS, **{name: FUNCTIONS[meant] for name, meant in SHORT.items()}, "K": 1}
_PLAIN = (
    *(ast.Expr, ast.Name, ast.Load, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call),
    *(ast.operator, ast.unaryop, ast.boolop, ast.cmpop),
)
_INSTEAD = {ast.IfExp: "; 'a if b else c' is where(b, a, c)", ast.Tuple: "; decimals have a point, no comma"}
"""What to write instead of some parts of Python that formulas don't have."""


def formula_effect(text: str, *, tried: bool = False) -> Effect:
    """The effect that a line of text describes. Raises InputError where it is not of the form above.

    It is run once, so that mistakes show before any fit, unless it was ``tried`` before.
    """
    head, *declared = text.split(";")
    parts = head.split(":", 2)
    if len(parts) != 3:
        raise InputError(f"--effect {text!r}: expected {FORM!r}")
    name, stage, body = (part.strip() for part in parts)
    if not re.fullmatch(r"[a-z]\w*", name):
        raise InputError(f"--effect {text!r}: name {name!r} must be lower-case letters, digits and _")
    if stage not in STAGES:
        raise InputError(f"--effect {text!r}: no stage {stage!r}{did_you_mean(stage, STAGES)}")
    more = [part.strip() for part in declared if _ASSIGNMENT.fullmatch(part)]
    parameters = tuple(_parameter(part, text) for part in declared if part.strip() and part.strip() not in more)
    if twice := duplicate_name(parameters):
        raise InputError(f"--effect {text!r}: parameter {twice!r} is declared twice")
    effect = _Formula(name, stage, tuple(_assignment(part, stage, text) for part in (body, *more)), parameters)
    return effect if tried else _checked(effect, text)


class _Assignment(NamedTuple):
    """One statement: its quantities, operator (``*``, ...; empty for ``=``), expression, and the names in it."""

    quantities: tuple[str, ...]
    how: str
    expression: str
    parsed: ast.Expr
    names: frozenset[str]

    def __str__(self) -> str:
        changed = "{0} -> {0} {1} ({2})" if self.how else "{0} -> {2}"
        return ", ".join(changed.format(name, self.how, self.expression) for name in self.quantities)


def _assignment(part: str, stage: str, text: str) -> _Assignment:
    assigned = _ASSIGNMENT.fullmatch(part)
    targets, how, expression = assigned.groups("") if assigned else (MAIN[stage], "", part)
    expression = expression.translate(_AS_TYPED)
    parsed = _parsed(expression, text)
    names = frozenset(node.id for node in ast.walk(parsed) if isinstance(node, ast.Name))
    return _Assignment(tuple(name.strip() for name in targets.split(",")), how, expression, parsed, names)


class _Formula(Effect):
    """Changes quantities of the chain by the values of expressions."""

    source = GIVEN
    seen_in = "-"

    def __init__(self, name: str, stage: str, sets: tuple[_Assignment, ...], parameters: tuple[Parameter, ...]) -> None:
        self.identifier, self.stage, self.sets, self.parameters = name, stage, sets, parameters
        self.formula = "; ".join(map(str, sets))
        self.names = frozenset[str]().union(*(statement.names for statement in sets))
        self.quantities = tuple(quantity for statement in sets for quantity in statement.quantities)
        self.first_step_differs = not DIFFERS_AT_FIRST.isdisjoint(self.names)
        self.readable = readable(stage)
        self.along_the_track = "sigma_phi" in map(self.readable.get, self.quantities)
        # An interpreter has one table of values, and the explorer fits in several threads.
        self._each_thread = threading.local()

    def __reduce__(self) -> tuple[Any, ...]:
        # A worker process makes its own interpreters.
        return _Formula, (self.identifier, self.stage, self.sets, self.parameters)

    def apply(self, chain: Chain, p: Values) -> None:
        """Evaluate the expressions on the chain's arrays, one after the other."""
        for sets in self.sets:
            value = self._value(sets, chain, p)
            for name in sets.quantities:
                meant = self.readable[name]
                put(chain, meant, _CHANGES[sets.how](get(chain, meant), np.multiply(value, 1.0)))

    def _value(self, sets: _Assignment, chain: Chain, p: Values) -> Any:
        interpreter: asteval.Interpreter | None = getattr(self._each_thread, "interpreter", None)
        if interpreter is None:
            interpreter = self._each_thread.interpreter = _interpreter()
        interpreter.symtable.update(
            {name: value(chain.robot) for name, (_, _, value) in CONSTANTS.items() if name in sets.names},
            first=float(chain.first_step),
            K=chain.k_of_phi,
        )
        interpreter.symtable.update(
            {name: get(chain, meant) for name, meant in self.readable.items() if name in sets.names and name not in p},
            **p,
        )
        interpreter.error, interpreter.error_msg = [], None
        try:
            # Division by 0, as of d_r/d at depth 0, shows in the result.
            with np.errstate(all="ignore"):
                value = interpreter.run(sets.parsed, expr=sets.expression)
        except Exception as error:
            _pass_on_interrupt(error)
            fault = interpreter.error[0]
            message = " ".join(f"{fault.exc.__name__}: {fault.msg}".split())
            raise InputError(f"effect {self.identifier}: {sets.expression}: {message}") from None
        finally:
            interpreter.code_text.clear()  # it would keep an entry for every call
        kind = value.dtype if hasattr(value, "dtype") else np.asarray(value).dtype
        if value is None or kind.kind not in "iuf":
            given = "nothing" if value is None else f"values of type {kind}"
            raise InputError(f"effect {self.identifier}: {sets.expression!r} gives {given}, expected numbers")
        return value


def _broadcast_like(old: Floats, new: Floats) -> Floats:
    """``new`` in place of ``old``, broadcast to its shape, as a number is; recorded quantities have no shape."""
    if not isinstance(old, np.ndarray):
        return new
    shape = np.broadcast_shapes(old.shape, np.shape(new))
    return new if np.shape(new) == shape else np.broadcast_to(new, shape).copy()


def _pass_on_interrupt(error: BaseException | None) -> None:
    """Raise KeyboardInterrupt for Ctrl-C, which asteval turns into an error of its own."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt
        error = error.__context__


def _interpreter() -> asteval.Interpreter:
    """An interpreter with the functions above and nothing else: no files, no imports, no loops."""
    interpreter = asteval.Interpreter(minimal=True, use_numpy=False)
    for name in list(interpreter.symtable):
        del interpreter.symtable[name]
    interpreter.symtable.update({name: getattr(np, name) for name in FUNCTIONS}, pi=np.pi)
    interpreter.symtable.update({name: getattr(np, meant) for name, meant in SHORT.items()})
    return interpreter


def _parameter(text: str, whole: str) -> Parameter:
    found = _PARAMETER.fullmatch(text)
    if not found:
        raise InputError(f"--effect {whole!r}: {text.strip()!r} is not 'parameter [unit] in low..high'")
    name, unit, low, high = found[1], found[2] or "1", float(found[3]), float(found[4])
    if not is_range(low, high):
        by = ", by 1e-100 to 1e100" if low < high else ""
        raise InputError(f"--effect {whole!r}: {name} in {low:g}..{high:g}: low must be below high{by}")
    if name in TAKEN:
        raise InputError(f"--effect {whole!r}: {name!r} has another meaning in formulas, choose another name")
    return Parameter(name, unit, low, high, 0.5 * (low + high) + 0.1 * (high - low), GIVEN)


def _parsed(expression: str, text: str) -> ast.Expr:
    try:
        parsed = ast.Expr(_ComparisonsAsNumbers().visit(tree(expression)))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # the last: nested too deep
        why = getattr(error, "msg", None) or str(error) or "nested too deep"
        at = expression[max((getattr(error, "offset", None) or 0) - 1, 0) :].strip()
        where = f" at {at!r}" if at not in ("", expression) else ""
        raise InputError(f"--effect {text!r}: {expression!r} is not an expression: {why}{where}") from None
    parts = list(ast.walk(parsed))
    if not all(_plain(part) for part in parts):
        instead = "".join(hint for kind, hint in _INSTEAD.items() if any(isinstance(part, kind) for part in parts))
        raise InputError(
            f"--effect {text!r}: only names, numbers, operators and functions; no '.', '[' or lambda{instead}"
        )
    for call in (part for part in parts if isinstance(part, ast.Call)):
        _check_call(call, text)
    return parsed


class _ComparisonsAsNumbers(ast.NodeTransformer):
    """Makes a comparison, or several joined by &, | and ~, the number 1 or 0: numpy would add booleans as "or".

    The value of a whole expression stays boolean: ``k == 3`` is no formula.
    """

    joined = True

    def visit(self, node: Any) -> Any:
        """The node multiplied by 1.0 if it is a comparison, except within joined ones."""
        joins = isinstance(getattr(node, "op", None), ast.BitAnd | ast.BitOr | ast.Invert)
        within, self.joined = self.joined, joins
        self.generic_visit(node)
        self.joined = within
        if within or not (joins or isinstance(node, ast.Compare)):
            return node
        return ast.BinOp(ast.Constant(1.0), ast.Mult(), node)


def _check_call(call: ast.Call, text: str) -> None:
    name = call.func.id if isinstance(call.func, ast.Name) else ""
    takes = _TAKES.get(name)
    if takes is None:
        raise InputError(f"--effect {text!r}: no function {name!r}{did_you_mean(name, sorted(_TAKES))}")
    if len(call.args) != takes:
        raise InputError(f"--effect {text!r}: {name}() takes {takes} value{'s' * (takes > 1)}, not {len(call.args)}")


def _plain(part: ast.AST) -> bool:
    """Whether a part of an expression is arithmetic; asteval allows more, which no formula needs."""
    if isinstance(part, ast.Constant):
        return isinstance(part.value, int | float)
    return isinstance(part, _PLAIN)


def _checked(effect: _Formula, text: str) -> Effect:
    """The effect, run once. Raises InputError for unknown names, names that can't be set, or no finite result."""
    for name in effect.quantities:
        if name not in effect.readable:
            raise InputError(f"--effect {text!r}: {name!r} can't be set at stage {effect.stage}{_hint(name, effect)}")
        if not settable(effect.readable[name]):
            raise InputError(f"--effect {text!r}: {name!r} can't be set, it follows from the clock and the step")
        if effect.readable[name] == "phi":
            raise InputError(f"--effect {text!r}: k does not follow {name!r}; k -> K({name} + ...) is that of another")
    own = {parameter.name for parameter in effect.parameters}
    changed = {effect.readable[name] for name in effect.quantities}
    for name in sorted(own & effect.readable.keys()):
        if effect.readable[name] in changed:
            raise InputError(f"--effect {text!r}: {name!r} is a quantity that is set, choose another name")
    for name in sorted(effect.names - own - effect.readable.keys() - CONSTANTS.keys() - _ALWAYS):
        raise InputError(f"--effect {text!r}: {name!r} is not known at stage {effect.stage}{_hint(name, effect)}")
    starts = {parameter.name: parameter.start for parameter in effect.parameters}
    with np.errstate(all="ignore"):
        found = Walker((effect,)).predict(Inputs(200.0, 10.0, 0.4, 0.6), [starts]).observables
        idle = not changes_something(effect)
    if not np.isfinite(found).all():
        raise InputError(f"--effect {text!r}: gives no number at k 200 N/m, ω 10 rad/s, φ 0.6 and {starts}")
    if idle:
        sets = ", ".join(effect.quantities)
        raise InputError(f"--effect {text!r}: changes nothing: {sets} stays the same, or is used before {effect.stage}")
    return effect


def _hint(name: str, effect: _Formula) -> str:
    """A suggestion for an unknown name."""
    if (stage := stage_of(name)) and name not in effect.readable:
        return f": it exists from stage {stage} on"
    own = [parameter.name for parameter in effect.parameters]
    close = near(name, [*own, *effect.readable, *CONSTANTS, *_ALWAYS])
    meant = f", did you mean {close!r}?" if close else ""
    return f"{meant} (effects --quantities lists the known ones; a parameter is declared: '; {name} [1] in 0..1')"
