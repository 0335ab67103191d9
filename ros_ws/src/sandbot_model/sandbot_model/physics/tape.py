"""The chain as a list of elementary operations, recorded by running it once on tracing objects, through every effect's
own ``apply``, also that of a formula or a user's effect. ``machine`` executes it.

A recording is one path through the code. An effect that depends on values or shapes, or calls an unknown function,
can't be recorded: the chain is then run on arrays (``Walker``).
"""

import pickle
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from sandbot_common.arrays import Floats, Ints
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.guarded import Replaced
from sandbot_model.physics.machine import BROADCAST, COMPARISONS, EACH, LOGICAL, NUMBER, OF_ROW, ONCE, UNARY
from sandbot_model.physics.stages import through
from sandbot_model.physics.walking import Walker, observables

CONDITIONS = ("k", "omega", "phi", "delta_t", "v_swim", "slow_phase_ratio", "swing_ratio", "slow_begin", "slow_end")
"""Inputs that are quantities of the chain; the others are named ``effect.parameter``."""
FEET, VIRGIN = ("depth", "walking"), ("virgin_depth", "virgin_walking")
"""Inputs from the footing, steady and on virgin ground."""


class Unrecordable(TypeError):
    """An operation that can't be recorded."""


class Recorded(Replaced, NDArrayOperatorsMixin):
    """A quantity of the chain on a tape: the register that holds it, and whether it is boolean (``truth``)."""

    def __init__(self, tape: "Tape", register: int, truth: bool = False) -> None:
        self.tape, self.register, self.truth = tape, register, truth
        self.dtype = np.dtype(bool if truth else float)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> "Recorded":
        if method != "__call__" or options:
            raise Unrecordable(f"{ufunc.__name__}.{method}")
        return self.tape.add(ufunc.__name__, *inputs)

    def __array_function__(self, function: Callable[..., Any], _types: Any, args: Any, options: Any) -> Any:
        if function not in _FUNCTIONS or options:
            raise Unrecordable(function.__name__)
        return _FUNCTIONS[function](self.tape, *args)

    def __bool__(self) -> bool:
        raise Unrecordable("a decision by value")

    def __array__(self, *_args: Any, **_options: Any) -> Floats:
        raise Unrecordable("an array by value")


_FUNCTIONS: dict[Callable[..., Any], Callable[..., Any]] = {
    np.where: lambda tape, *args: tape.add("where", *args),
    np.clip: lambda tape, x, low, high: tape.add("minimum", tape.add("maximum", x, low), high),
    np.interp: lambda tape, x, xp, fp: tape.interp(x, xp, fp),
}


class Tape:
    """Operations ``(operation, out, a, b, c)`` on registers: the inputs, then constants and results in order."""

    def __init__(self, inputs: Iterable[str]) -> None:
        self.inputs = {name: register for register, name in enumerate(inputs)}
        self.constants: dict[float, int] = {}
        self.code: list[tuple[int, int, int, int, int]] = []
        self.outputs: dict[str, int] = {}
        self.tables: list[tuple[Floats, Floats]] = []
        self.registers = len(self.inputs)
        self.programs: dict[Hashable, Any] = {}
        """Cache of what has been compiled from it."""
        self._recorded: dict[tuple[int, int, int, int], Recorded] = {}

    def input(self, name: str) -> Recorded:
        """The input of this name."""
        return Recorded(self, self.inputs[name])

    def output(self, name: str, value: Any) -> None:
        """Name a result as an output."""
        self.outputs[name] = self._register(value)[0]

    def add(self, name: str, *values: Any) -> Recorded:
        """Record an operation, unless the same one was recorded before."""
        name = _OF_BOOLEANS.get(name, name)
        if name == "power" and isinstance(values[1], int | float) and values[1] in _POWERS:
            power: Recorded = _POWERS[values[1]](values[0])
            return power
        if name in _NEUTRAL and (kept := _identity(name, values)) is not None:
            return kept
        if name not in NUMBER or len(values) != _COUNT[NUMBER[name]]:
            raise Unrecordable(name)
        registers, truths = zip(*map(self._register, values), strict=True)
        if (name in LOGICAL) != all(truths) and name not in ("where", *COMPARISONS):
            raise Unrecordable(f"{name} of truth values" if all(truths) else f"{name} of numbers")
        return self._emit((NUMBER[name], *registers, *(0,) * (3 - len(registers))), name in (*COMPARISONS, *LOGICAL))

    def interp(self, x: Any, xp: Any, fp: Any) -> Recorded:
        """Linear interpolation in a constant table."""
        self.tables.append((np.array(xp, dtype=float), np.array(fp, dtype=float)))
        return self._emit((NUMBER["interp"], self._register(x)[0], len(self.tables) - 1, 0), False)

    def curve(self, phi: Any) -> Any:
        """The fitted stiffness at another volume fraction; the input ``k`` where there is no curve."""
        return self._emit((NUMBER["curve"], self._register(phi)[0], self.inputs["k"], 0), False)

    def close(self) -> None:
        """End the recording."""
        self._recorded.clear()

    def _emit(self, what: tuple[int, int, int, int], truth: bool) -> Recorded:
        if what not in self._recorded:
            operation, *operands = what
            self.code.append((operation, self.registers, *operands))  # type: ignore[arg-type]
            self._recorded[what] = Recorded(self, self.registers, truth)
            self.registers += 1
        return self._recorded[what]

    def _register(self, value: Any) -> tuple[int, bool]:
        if isinstance(value, Recorded):
            return value.register, value.truth
        if np.shape(value) != ():
            raise Unrecordable(f"an array of shape {np.shape(value)}")
        number = float(value)
        if number not in self.constants:
            self.constants[number] = self.registers
            self.registers += 1
        return self.constants[number], isinstance(value, bool | np.bool_)


_POWERS: dict[float, Callable[[Any], Any]] = {1: lambda x: x, 2: lambda x: x * x, 0.5: np.sqrt, -1: lambda x: 1.0 / x}
"""Powers that numpy, too, computes without a logarithm."""


_OF_BOOLEANS = {"invert": "logical_not", "bitwise_and": "logical_and", "bitwise_or": "logical_or"}
"""~, & and | of booleans; of numbers they are not recorded."""


def _identity(name: str, values: Sequence[Any]) -> Recorded | None:
    """The operand x of an operation that does not change it (x + 0, x - 0, 1 x, x/1), else None."""
    pairs = [tuple(values), tuple(values[::-1])] if name in ("add", "multiply") else [tuple(values)]
    for kept, other in pairs:
        constant = not isinstance(other, Recorded) and np.ndim(other) == 0
        if constant and other == _NEUTRAL[name] and isinstance(kept, Recorded) and not kept.truth:
            return kept
    return None


_NEUTRAL = {"add": 0.0, "subtract": 0.0, "multiply": 1.0, "divide": 1.0}
_OPERANDS = {name: 1 for name in (*UNARY, "logical_not")} | {"where": 3, "interp": 1}
_COUNT = {number: _OPERANDS.get(name, 2) for name, number in NUMBER.items()}
"""How many registers an operation reads."""


def record(walker: Walker) -> Tape | None:
    """The chain of a walker as operations; None where an effect can't be recorded.

    Outputs are the names of the observables, ``margin`` and ``virgin_margin`` [N] and ``sigma_phi``.
    """
    names = [f"{effect.identifier}.{p.name}" for effect in walker.effects for p in effect.parameters]
    tape = Tape([*CONDITIONS, *FEET, *VIRGIN, *names])
    try:
        steady = _chain(tape, walker, FEET[0], first_step=False)
        virgin = _chain(tape, walker, VIRGIN[0], first_step=True) if walker.remembers else steady
        walking: Any = [tape.input(name) for name in (FEET[1], VIRGIN[1])]
        for name, value in observables(steady, virgin, *walking).items():
            tape.output(name, value)
        tape.output("margin", steady.margin)
        tape.output("virgin_margin", virgin.margin)
        tape.output("sigma_phi", steady.sigma_phi)
        tape.close()
    except Exception:  # a user's effect may do anything with what it expects to be arrays
        return None
    return tape


@lru_cache(maxsize=256)
def recorded(pickled: bytes) -> Tape | None:
    """``record`` of a walker's pickled effects and robot, cached: a worker process is sent them with every task."""
    return record(Walker(*pickle.loads(pickled)))


def _chain(tape: Tape, walker: Walker, depth: str, *, first_step: bool) -> Chain:
    quantities: Any = {name: tape.input(name) for name in CONDITIONS} | {"depth": tape.input(depth)}
    chain = Chain(walker.robot, **quantities, first_step=first_step, k_of_phi=tape.curve)
    return through(chain, [(effect, _parameters(tape, effect)) for effect in walker.effects])


def _parameters(tape: Tape, effect: Effect) -> Any:
    return {p.name: tape.input(f"{effect.identifier}.{p.name}") for p in effect.parameters}


class Program(NamedTuple):
    """A list of operations as ``machine`` executes it."""

    code: Ints
    """Operation, register of the result, three operand registers, where it is done (``machine.EACH`` and so on)."""
    inputs: Ints
    """Register, what the input depends on (``machine.OF_ROW`` and so on), and its column there."""
    outputs: Ints
    registers: int
    constants: Floats
    """Register and value ``(n, 2)``."""
    tables: Floats
    """x and y of each table in turn, ``(2 tables, longest)``, the last point repeated."""


def program(
    tape: Tape, outputs: Sequence[str], inputs: Mapping[str, tuple[int, int]], fixed: Mapping[str, float]
) -> Program:
    """The operations needed for these outputs, in order.

    ``inputs`` give what each depends on and its column there; other inputs have ``fixed`` values.
    """
    wanted = {tape.outputs[name] for name in outputs}
    needed = []
    for operation in reversed(tape.code):
        if operation[1] in wanted:
            needed.append(operation)
            wanted.update(_operands_of(operation))
    own = [(tape.inputs[name], *of) for name, of in inputs.items() if tape.inputs[name] in wanted]
    constants = [(register, value) for value, register in tape.constants.items()]
    constants += [(tape.inputs[name], value) for name, value in fixed.items()]
    same = {register for register, of, _ in own if of == OF_ROW} | {register for register, _ in constants}
    results = np.array([tape.outputs[name] for name in outputs])
    return Program(
        _with_marks(np.array(needed[::-1], dtype=np.int64).reshape(-1, 5), same, results),
        np.array(own, dtype=np.int64).reshape(-1, 3),
        results,
        tape.registers,
        np.array(constants, dtype=float).reshape(-1, 2),
        _padded(tape.tables),
    )


class Moved(NamedTuple):
    """The parts of a program to repeat where some of its inputs are moved, as for a finite difference. They write to
    additional registers, so that those of the program keep their values."""

    code: Ints
    """As that of a ``Program``, the moves one after the other."""
    lines: Ints
    """Where the code of each move begins, and the last ends ``(moves + 1,)``."""
    inputs: Ints
    """As those of a ``Program``."""
    own: Ints
    """Where the inputs of each move begin, and the last end."""
    results: Ints
    """The registers of the outputs ``(moves, outputs)``."""


def moved(plain: Program, moves: Sequence[set[int]]) -> Moved:
    """The parts of a program that depend on moved inputs, given as a set of registers for each move."""
    code, lines, its_inputs, results = plain.code.tolist(), [0], [0], []
    repeated: list[list[int]] = []
    inputs: list[list[int]] = []
    for registers in moves:
        own = {register: register + plain.registers for register in registers}
        for line in code:
            operands = _operands_of(line)
            if not own.keys().isdisjoint(operands):
                own[line[1]] = line[1] + plain.registers
                changed = [own.get(register, register) for register in operands]
                repeated.append([line[0], own[line[1]], *changed, *line[2 + len(changed) :]])
        inputs += [[own[at], kind, column] for at, kind, column in plain.inputs.tolist() if at in registers]
        lines.append(len(repeated))
        its_inputs.append(len(inputs))
        results.append([own.get(register, register) for register in plain.outputs.tolist()])

    def columns(rows: Sequence[Sequence[int]], count: int) -> Ints:
        return np.array(rows, dtype=np.int64).reshape(-1, count)

    ends = np.array(lines), np.array(its_inputs)
    return Moved(columns(repeated, 6), ends[0], columns(inputs, 3), ends[1], columns(results, len(plain.outputs)))


def by_depth(plain: Program) -> tuple[Program, Ints]:
    """A program sorted by loop level, and where the lines that depend on the row, the cell and the node begin."""
    level = {int(register): 1 + int(of) for register, of, _ in plain.inputs}
    for line in plain.code.tolist():
        # The curve depends on the row.
        own = 1 if line[0] == NUMBER["curve"] else 0
        level[line[1]] = max(own, *(level.get(register, 0) for register in _operands_of(line)))
    levels = np.array([level[line[1]] for line in plain.code.tolist()], dtype=np.int64)
    order = np.argsort(levels, kind="stable")
    # Everything but the depth is the same at all depths of the grid.
    same = {*plain.inputs[:, 0].tolist(), *plain.constants[:, 0].astype(int).tolist()}
    code = _with_marks(plain.code[order, :5], same, plain.outputs)
    return plain._replace(code=code), np.searchsorted(levels[order], [1, 2, 3])


def depth_last(plain: Program, depth: int) -> tuple[Program, int]:
    """The program with the lines that depend on the register ``depth`` moved to the end, and where they begin."""
    moved = {depth}
    for line in plain.code.tolist():
        if not moved.isdisjoint(_operands_of(line)):
            moved.add(line[1])
    last = np.isin(plain.code[:, 1], list(moved))
    return plain._replace(code=np.concatenate([plain.code[~last], plain.code[last]])), int(np.count_nonzero(~last))


def _with_marks(code: Ints, same: set[int], outputs: Ints) -> Ints:
    """The code with a column that says where each operation is done (``machine.EACH`` and so on): once if its result is
    the same at all points, as the registers ``same`` are."""
    same, read = set(same), set(outputs.tolist())
    for line in code.tolist():
        if all(register in same for register in _operands_of(line)):
            same.add(line[1])
        else:
            read.update(_operands_of(line))
    marks = [(BROADCAST if out in read else ONCE) if out in same else EACH for out in code[:, 1].tolist()]
    return np.column_stack([code, np.array(marks, dtype=np.int64)])


def _operands_of(operation: Sequence[int]) -> tuple[int, ...]:
    number, _, *registers = operation
    return tuple(registers[: _COUNT[number]])


def _padded(tables: Sequence[tuple[Floats, Floats]]) -> Floats:
    longest = max((len(x) for x, _ in tables), default=1)
    return np.array([np.pad(row, (0, longest - len(row)), mode="edge") for table in tables for row in table]).reshape(
        -1, longest
    )
