"""Formulas of effects as MathML, which browsers show without a library.

A formula is statements separated by ``;`` and, after a colon, words:

    "s -> s*e; peak -> peak*e; e = clip(1 - F_c/F_x, 0, 1); F_x = 1.5*alpha_x*w*d^2; alpha_x = 146e3 [N/m^3]: remark"

``quantity -> expression`` is a change of the chain, ``name = expression [unit]`` or ``f(x) = expression`` says what a
name stands for; docs/physics.md §6 lists the quantities. What does not read like that (a user's own words) is shown as
it is.
"""

import ast
import re
from collections.abc import Callable
from html import escape
from typing import NamedTuple

LETTERS = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau phi chi psi omega",
    "αβγδεζηθκλμνξπρστφχψω",
)
GREEK = dict(zip(LETTERS[0].split(), LETTERS[1], strict=True))
_STATEMENT = re.compile(
    r"(?P<left>[A-Za-z_]\w*(?:\(\w+\))?)\s*(?P<how>->|=)\s*(?P<right>[^[]+?)\s*(?:\[(?P<unit>[^]]*)\])?"
)
_SIGNS: dict[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "−", ast.Gt: "&gt;", ast.Lt: "&lt;"}
_TIMES, _DOT = "\u2062", "·"
"""Letters multiply by standing side by side; words and numbers would run together."""
_RAISED = str.maketrans({"^": None, "2": "²", "3": "³"})
_CHOICE, _SUM, _PRODUCT, _POWER, _ATOM = range(5)
"""How tightly an expression holds together."""


class Statement(NamedTuple):
    """``left -> right`` or ``left = right``, and the right side's unit."""

    left: str
    how: str
    right: str
    unit: str


def statements(formula: str) -> tuple[tuple[Statement, ...], str]:
    """A formula's statements and its words. Raises ValueError where it does not read like that."""
    body, _, words = formula.partition(":")
    found = []
    for part in body.split(";"):
        match = _STATEMENT.fullmatch(part.strip())
        if match is None:
            raise ValueError(f"{part.strip()!r} is no statement of a formula")
        found.append(Statement(match["left"], match["how"], match["right"].replace("^", "**"), match["unit"] or ""))
    return tuple(found), words.strip()


def mathml(formula: str) -> str:
    """The formula as a ``<math>`` element."""
    lines, words = _typeset(formula)
    shown = "<mtext>;&#160; </mtext>".join(lines)
    separator = "<mtext>,&#160;</mtext>" if shown and words else ""  # a plain space at an end is not shown
    return f"<math>{shown}{separator}{f'<mtext>{escape(words)}</mtext>' if words else ''}</math>"


def mathml_in_pieces(formula: str) -> str:
    """The same as a ``<math>`` for each statement, between which a narrow column may break its lines."""
    lines, words = _typeset(formula)
    shown = "; ".join(f"<math>{line}</math>" for line in lines)
    return ", ".join(filter(None, (shown, escape(words))))


def mathml_lines(formula: str) -> tuple[str, ...]:
    """The same as HTML for each statement, and one for the words, to stand below each other, fractions at full size."""
    lines, words = _typeset(formula)
    return (*(f'<math displaystyle="true">{line}</math>' for line in lines), *filter(None, [escape(words)]))


def _typeset(formula: str) -> tuple[list[str], str]:
    """The inside of each statement's ``<math>``, and the words; all is words where it does not read like a formula."""
    try:
        lines, words = statements(formula)
        return [_line(line) for line in lines], plain(words)
    except (ValueError, SyntaxError):
        return [], formula


def plain(formula: str) -> str:
    """The formula on a line of a terminal, Greek letters for their names; what it shows may be typed."""
    shown = re.sub(r"[A-Za-z]\w*", lambda name: _letters(name[0]), formula.replace("->", "→").replace("^2", "²"))
    return shown.replace("*", "·")


def _letters(name: str) -> str:
    head, _, subscript = name.partition("_")
    if head == "Delta":
        return f"Δ{_letters(subscript)}"
    return "_".join(filter(None, (GREEK.get(head, head), GREEK.get(subscript, subscript))))


def _line(statement: Statement) -> str:
    sign = "→" if statement.how == "->" else "="
    unit = f"<mtext>&#160;{escape(statement.unit.translate(_RAISED))}</mtext>" if statement.unit else ""
    return f"{_shown(statement.left)[0]}<mo>{sign}</mo>{_shown(statement.right)[0]}{unit}"


def _shown(expression: str) -> tuple[str, int]:
    return _node(ast.parse(expression, mode="eval").body)


def _node(node: ast.expr) -> tuple[str, int]:
    """MathML of an expression and how tightly it holds together."""
    match node:
        case ast.Name(id=name):
            return _name(name), _ATOM
        case ast.Constant(value=int() | float() as value):
            return f"<mn>{value:g}</mn>", _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"<mrow><mo>−</mo>{_held(operand, _PRODUCT)}</mrow>", _SUM
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return f"<mfrac>{_row(left)}{_row(right)}</mfrac>", _PRODUCT
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return f"<msup>{_held(left, _ATOM)}{_row(right)}</msup>", _POWER
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            one, sign, other = _held(left, _PRODUCT), _times(left, right), _held(right, _PRODUCT)
            return f"<mrow>{one}<mo>{sign}</mo>{other}</mrow>", _PRODUCT
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as sign, right=right):
            after = _held(right, _PRODUCT if isinstance(sign, ast.Sub) else _SUM)
            return f"<mrow>{_held(left, _SUM)}<mo>{_SIGNS[type(sign)]}</mo>{after}</mrow>", _SUM
        case ast.Compare(left=left, ops=[ast.Gt() | ast.Lt() as sign], comparators=[right]):
            return f"<mrow>{_row(left)}<mo>{_SIGNS[type(sign)]}</mo>{_row(right)}</mrow>", _SUM
        case ast.Call(func=ast.Name(id="where"), args=[condition, value, otherwise]):
            return _choice(_row(condition), _held(value, _SUM), _held(otherwise, _SUM)), _CHOICE
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _CALLS.get(name, _call)(name, [_row(argument) for argument in arguments]), _ATOM
    raise ValueError(f"{ast.unparse(node)!r} is not typeset")


def _row(node: ast.expr) -> str:
    return f"<mrow>{_node(node)[0]}</mrow>"


def _held(node: ast.expr, tightness: int) -> str:
    """With parentheses where it holds together less tightly than that."""
    shown, own = _node(node)
    return shown if own >= tightness else f"<mrow><mo>(</mo>{shown}<mo>)</mo></mrow>"


def _times(left: ast.expr, right: ast.expr) -> str:
    return _DOT if _is_word(left) or _is_word(right) or isinstance(right, ast.Constant) else _TIMES


def _is_word(factor: ast.expr) -> bool:
    """Whether it is, or is a product or power of, a name of several letters or a function's value."""
    match factor:
        case ast.Name(id=name):
            return len(_letters(name).partition("_")[0]) > 1
        case ast.Call(func=ast.Name(id=name)):
            return name not in ("where", *_CALLS)  # a choice is in parentheses, a root has its own bounds
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _is_word(left) or _is_word(right)
        case ast.BinOp(left=left, op=ast.Pow()):
            return _is_word(left)
    return False


def _name(name: str) -> str:
    head, _, subscript = name.partition("_")
    if head == "Delta":
        return f"<mrow><mi>Δ</mi>{_name(subscript)}</mrow>"
    symbol = f"<mi>{GREEK.get(head, head)}</mi>"
    return f"<msub>{symbol}<mi>{GREEK.get(subscript, subscript)}</mi></msub>" if subscript else symbol


def _call(name: str, arguments: list[str]) -> str:
    inside = "<mo>,</mo>".join(arguments)
    return f"<mrow>{_name(name)}<mo>\u2061</mo><mo>(</mo>{inside}<mo>)</mo></mrow>"


def _root(_name: str, arguments: list[str]) -> str:
    return f"<msqrt>{arguments[0]}</msqrt>"


def _hypotenuse(_name: str, arguments: list[str]) -> str:
    return f"<msqrt>{'<mo>+</mo>'.join(f'<msup>{side}<mn>2</mn></msup>' for side in arguments)}</msqrt>"


def _choice(condition: str, value: str, otherwise: str) -> str:
    return f"<mrow>{value}<mtext>&#160;if&#160;</mtext>{condition}<mtext>, else&#160;</mtext>{otherwise}</mrow>"


_CALLS: dict[str, Callable[[str, list[str]], str]] = {"sqrt": _root, "hypot": _hypotenuse}
