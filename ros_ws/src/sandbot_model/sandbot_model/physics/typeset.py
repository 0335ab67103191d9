"""Formulas of effects as MathML, which browsers render without a library.

A formula is statements separated by ``;`` and, after a colon, words:

    "s -> s*e; peak -> peak*e; e = clip(1 - F_c/F_x, 0, 1); F_x = 1.5*alpha_x*w*d^2; alpha_x = 146e3 [N/m^3]: remark"

``quantity -> expression`` changes a quantity of the chain, ``name = expression [unit]`` or ``f(x) = expression``
defines a name; docs/physics.md §6 lists the quantities. Anything else (a user's own words) is shown unchanged.
"""

import ast
import re
from collections.abc import Callable
from html import escape
from typing import NamedTuple

from sandbot_model.physics.syntax import tree

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
"""Letters are multiplied by juxtaposition; words and numbers would run together."""
_RAISED = str.maketrans({"^": None, "2": "²", "3": "³"})
_CHOICE, _SUM, _PRODUCT, _POWER, _ATOM = range(5)
"""Precedence of an expression."""


class Statement(NamedTuple):
    """``left -> right`` or ``left = right``, and the right side's unit."""

    left: str
    how: str
    right: str
    unit: str


def statements(formula: str) -> tuple[tuple[Statement, ...], str]:
    """A formula's statements and its words. Raises ValueError for text of another form."""
    body, _, words = formula.partition(":")
    found = []
    for part in body.split(";"):
        match = _STATEMENT.fullmatch(part.strip())
        if match is None:
            raise ValueError(f"{part.strip()!r} is not a statement of a formula")
        found.append(Statement(match["left"], match["how"], match["right"].replace("^", "**"), match["unit"] or ""))
    return tuple(found), words.strip()


def mathml(formula: str) -> str:
    """The formula as a ``<math>`` element."""
    lines, words = _typeset(formula)
    shown = "<mtext>;&#160; </mtext>".join(lines)
    separator = "<mtext>,&#160;</mtext>" if shown and words else ""  # a plain space at an end is not shown
    return f"<math>{shown}{separator}{f'<mtext>{escape(words)}</mtext>' if words else ''}</math>"


def mathml_in_pieces(formula: str) -> str:
    """The same with a ``<math>`` element per statement, between which lines may break."""
    lines, words = _typeset(formula)
    shown = "; ".join(f"<math>{line}</math>" for line in lines)
    return ", ".join(filter(None, (shown, escape(words))))


def mathml_lines(formula: str) -> tuple[str, ...]:
    """The same as lines of HTML, one per statement and one for the words, fractions at full size."""
    lines, words = _typeset(formula)
    return (*(f'<math displaystyle="true">{line}</math>' for line in lines), *filter(None, [escape(words)]))


def _typeset(formula: str) -> tuple[list[str], str]:
    """The content of each statement's ``<math>``, and the words; text that is no formula is all words."""
    try:
        lines, words = statements(formula)
        return [_line(line) for line in lines], plain(words)
    except (ValueError, SyntaxError):
        return [], formula


def plain(formula: str) -> str:
    """The formula as a line of plain text with Greek letters; what it shows may be typed."""
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
    return _node(tree(expression))


def _node(node: ast.expr) -> tuple[str, int]:
    """MathML of an expression and its precedence."""
    match node:
        case ast.Name(id=name):
            return _name(name), _ATOM
        case ast.Constant(value=int() | float() as value):
            return f"<mn>{value:g}</mn>", _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"<mrow><mo>−</mo>{_parenthesised(operand, _PRODUCT)}</mrow>", _SUM
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return f"<mfrac>{_row(left)}{_row(right)}</mfrac>", _PRODUCT
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return f"<msup>{_parenthesised(left, _ATOM)}{_row(right)}</msup>", _POWER
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            one, sign, other = _parenthesised(left, _PRODUCT), _times(left, right), _parenthesised(right, _PRODUCT)
            return f"<mrow>{one}<mo>{sign}</mo>{other}</mrow>", _PRODUCT
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as sign, right=right):
            after = _parenthesised(right, _PRODUCT if isinstance(sign, ast.Sub) else _SUM)
            return f"<mrow>{_parenthesised(left, _SUM)}<mo>{_SIGNS[type(sign)]}</mo>{after}</mrow>", _SUM
        case ast.Compare(left=left, ops=[ast.Gt() | ast.Lt() as sign], comparators=[right]):
            return f"<mrow>{_row(left)}<mo>{_SIGNS[type(sign)]}</mo>{_row(right)}</mrow>", _SUM
        case ast.Call(func=ast.Name(id="where"), args=[condition, value, otherwise]):
            return _choice(_row(condition), _parenthesised(value, _SUM), _parenthesised(otherwise, _SUM)), _CHOICE
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _CALLS.get(name, _call)(name, [_row(argument) for argument in arguments]), _ATOM
    raise ValueError(f"{ast.unparse(node)!r} is not typeset")


def _row(node: ast.expr) -> str:
    return f"<mrow>{_node(node)[0]}</mrow>"


def _parenthesised(node: ast.expr, precedence: int) -> str:
    """In parentheses where its precedence is lower than ``precedence``."""
    shown, own = _node(node)
    return shown if own >= precedence else f"<mrow><mo>(</mo>{shown}<mo>)</mo></mrow>"


def _times(left: ast.expr, right: ast.expr) -> str:
    return _DOT if _is_word(left) or _is_word(right) or isinstance(right, ast.Constant) else _TIMES


def _is_word(factor: ast.expr) -> bool:
    """Whether it is a name of several letters or a function call, or a product or power of one."""
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
