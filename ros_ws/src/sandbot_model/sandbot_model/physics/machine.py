"""Executes a chain recorded as a list of operations (see ``tape``); compiled once, for all chains.

A register holds one quantity at a block of points, and every operation runs over all of them. In the search for a
footing the points are the depths of a grid; operations that do not depend on the row, cell or node of the fit are done
once, outside the loop over it.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import math

import numpy as np

from sandbot_common.compiled import compiled

UNARY = (
    *("negative", "absolute", "sign", "floor", "sqrt", "exp", "log", "log10", "sin", "cos", "tan"),
    *("arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"),
)
BINARY = ("add", "subtract", "multiply", "divide", "minimum", "maximum", "power", "arctan2", "hypot")
COMPARISONS = ("less", "less_equal", "greater", "greater_equal", "equal", "not_equal")
LOGICAL = ("logical_and", "logical_or", "logical_not")
NUMBER = {name: at for at, name in enumerate((*UNARY, *BINARY, *COMPARISONS, *LOGICAL, "where", "interp", "curve"))}
"""Numbers of the operations, by numpy's names."""

NEGATIVE, ABSOLUTE, SIGN, FLOOR, SQRT, EXP, LOG, LOG10, SIN, COS, TAN, ARCSIN, ARCCOS, ARCTAN, SINH, COSH, TANH = range(
    17
)
ADD, SUBTRACT, MULTIPLY, DIVIDE, MINIMUM, MAXIMUM, POWER, ARCTAN2, HYPOT = range(17, 26)
LESS, LESS_EQUAL, GREATER, GREATER_EQUAL, EQUAL, NOT_EQUAL, AND, OR, NOT, WHERE, INTERP, CURVE = range(26, 38)

OF_ROW, OF_CELL, OF_NODE, OF_FEET = range(4)
"""What an input depends on (feet: depth and walking of a point)."""
EACH, ONCE, BROADCAST = range(3)
"""Whether an operation is done at each point, once for all, or once and then copied to all points."""
BLOCK = 256
"""Points of a block, so few that their registers stay in the processor's cache."""

_compiled = compiled(nogil=True, error_model="numpy")


@_compiled
def _function(operation, x):  # noqa: C901
    if operation == EXP:
        return math.exp(x)
    if operation == SIN:
        return math.sin(x)
    if operation == COS:
        return math.cos(x)
    if operation == ARCSIN:
        return math.asin(x)
    if operation == ARCCOS:
        return math.acos(x)
    if operation == LOG:
        return math.log(x) if x > 0 else (-np.inf if x == 0 else np.nan)
    if operation == TAN:
        return math.tan(x)
    if operation == ARCTAN:
        return math.atan(x)
    if operation == TANH:
        return math.tanh(x)
    if operation == FLOOR:
        return np.floor(x)
    if operation == SIGN:
        return np.sign(x)
    if operation == LOG10:
        return math.log10(x) if x > 0 else (-np.inf if x == 0 else np.nan)
    if operation == SINH:
        return math.sinh(x)
    return math.cosh(x)


@_compiled
def _of_two(operation, x, y):
    if operation == POWER:
        return x**y
    if operation == HYPOT:
        return math.hypot(x, y)
    if operation == ARCTAN2:
        return math.atan2(x, y)
    if operation == EQUAL:
        return 1.0 if x == y else 0.0
    if operation == NOT_EQUAL:
        return 1.0 if x != y else 0.0
    if operation == AND:
        return x * y
    return max(x, y)


@_compiled
def interpolated(x, xp, fp):
    """As ``np.interp`` for one x."""
    if x != x:
        return x
    if x >= xp[-1]:
        return fp[-1]
    if x < xp[0]:
        return fp[0]
    at = np.searchsorted(xp, x, side="right") - 1
    return (fp[at + 1] - fp[at]) / (xp[at + 1] - xp[at]) * (x - xp[at]) + fp[at]


@_compiled
def _run(code, begin, end, reg, n, tables, phi, k):  # noqa: C901
    """Do operations ``begin`` to ``end`` at the first ``n`` points; ``phi (levels,)`` and ``k`` are the curve k(φ)."""
    for line in range(begin, end):
        operation, out, a, b, c = code[line, 0], code[line, 1], code[line, 2], code[line, 3], code[line, 4]
        points = n if code[line, 5] == EACH else 1
        if operation == MULTIPLY:
            for i in range(points):
                reg[out, i] = reg[a, i] * reg[b, i]
        elif operation == ADD:
            for i in range(points):
                reg[out, i] = reg[a, i] + reg[b, i]
        elif operation == SUBTRACT:
            for i in range(points):
                reg[out, i] = reg[a, i] - reg[b, i]
        elif operation == DIVIDE:
            for i in range(points):
                reg[out, i] = reg[a, i] / reg[b, i]
        elif operation == MINIMUM:
            for i in range(points):
                reg[out, i] = reg[a, i] if reg[a, i] < reg[b, i] or reg[a, i] != reg[a, i] else reg[b, i]
        elif operation == MAXIMUM:
            for i in range(points):
                reg[out, i] = reg[a, i] if reg[a, i] > reg[b, i] or reg[a, i] != reg[a, i] else reg[b, i]
        elif operation == SQRT:
            for i in range(points):
                reg[out, i] = math.sqrt(reg[a, i]) if reg[a, i] >= 0.0 else np.nan
        elif operation == WHERE:
            for i in range(points):
                # Both are read first: the compiler makes no vector of what it reads on a condition.
                there, elsewhere = reg[b, i], reg[c, i]
                reg[out, i] = there if reg[a, i] != 0.0 else elsewhere
        elif operation == LESS:
            for i in range(points):
                reg[out, i] = 1.0 if reg[a, i] < reg[b, i] else 0.0
        elif operation == LESS_EQUAL:
            for i in range(points):
                reg[out, i] = 1.0 if reg[a, i] <= reg[b, i] else 0.0
        elif operation == GREATER:
            for i in range(points):
                reg[out, i] = 1.0 if reg[a, i] > reg[b, i] else 0.0
        elif operation == GREATER_EQUAL:
            for i in range(points):
                reg[out, i] = 1.0 if reg[a, i] >= reg[b, i] else 0.0
        elif operation == NEGATIVE:
            for i in range(points):
                reg[out, i] = -reg[a, i]
        elif operation == ABSOLUTE:
            for i in range(points):
                reg[out, i] = abs(reg[a, i])
        elif operation == NOT:
            for i in range(points):
                reg[out, i] = 1.0 - reg[a, i]
        elif operation == INTERP:
            for i in range(points):
                reg[out, i] = interpolated(reg[a, i], tables[2 * b], tables[2 * b + 1])
        elif operation == CURVE:
            for i in range(points):
                reg[out, i] = interpolated(reg[a, i], phi, k) if len(phi) else reg[b, i]
        elif operation < ADD:
            for i in range(points):
                reg[out, i] = _function(operation, reg[a, i])
        else:
            for i in range(points):
                reg[out, i] = _of_two(operation, reg[a, i], reg[b, i])
        if code[line, 5] == BROADCAST:
            for i in range(1, n):
                reg[out, i] = reg[out, 0]


@_compiled
def _load(inputs, points, feet, row, which, reg):
    """Load the inputs of points ``which`` of a row, numbered in the order of (cells, nodes), into their registers."""
    theta, conditions, its = points[0], points[1][:, row % points[1].shape[1]], points[2][row % len(points[2])]
    nodes = its.shape[1]
    # Divided here, once: a division costs more than most operations of a chain.
    cell = which // nodes
    for at in range(len(inputs)):
        to, kind, column = inputs[at, 0], inputs[at, 1], inputs[at, 2]
        if kind == OF_ROW:
            reg[to, : len(which)] = theta[row, column]
        elif kind == OF_FEET:
            for i in range(len(which)):
                reg[to, i] = feet[column, row, which[i]]
        elif kind == OF_CELL:
            for i in range(len(which)):
                reg[to, i] = conditions[column, cell[i]]
        else:
            for i in range(len(which)):
                reg[to, i] = its[cell[i] if len(its) > 1 else 0, which[i] - nodes * cell[i]]


@_compiled
def _registers(count, n, constants):
    reg = np.empty((count, n))
    for at in range(len(constants)):
        reg[int(constants[at, 0])] = constants[at, 1]
    return reg


@_compiled
def evaluate(program, points, feet):
    """The outputs of a program at points: ``(outputs, rows, cells * nodes)``.

    ``points`` are the inputs of the rows ``(rows, columns)``, those of the cells ``(columns, rows or 1, cells)``, k
    ``(rows or 1, cells or 1, nodes)``, and φ ``(levels,)`` and k ``(rows or 1, levels)`` of the fitted curve; ``feet
    (columns, rows, cells * nodes)`` are depth and walking, steady and on virgin ground.
    """
    code, inputs, outputs, count, constants, tables = program
    rows, each, phi, curve = len(points[0]), points[1].shape[2] * points[2].shape[2], points[3], points[4]
    reg = _registers(count, BLOCK, constants)
    found = np.empty((len(outputs), rows, each))
    for row in range(rows):
        for first in range(0, each, BLOCK):
            n = min(BLOCK, each - first)
            _load(inputs, points, feet, row, np.arange(first, first + n), reg)
            _run(code, 0, len(code), reg, n, tables, phi, curve[row % len(curve)])
            for at in range(len(outputs)):
                found[at, row, first : first + n] = reg[outputs[at], :n]
    return found


@_compiled
def evaluate_moved(program, moved, points, feet, rows):
    """The outputs of a program at points in blocks of ``rows`` rows ``(outputs, blocks * rows, cells * nodes)``.

    In the last block nothing is moved; in each one before it some inputs are, and only what depends on these is
    repeated (see ``tape.Moved``).
    """
    code, inputs, outputs, count, constants, tables = program
    lines, its_lines, own, its_own, results = moved
    each, phi, curve = points[1].shape[2] * points[2].shape[2], points[3], points[4]
    reg, blocks = _registers(2 * count, BLOCK, constants), len(results)
    found = np.empty((len(outputs), (blocks + 1) * rows, each))
    for row in range(rows):
        for first in range(0, each, BLOCK):
            n = min(BLOCK, each - first)
            which, here = np.arange(first, first + n), blocks * rows + row
            _load(inputs, points, feet, here, which, reg)
            _run(code, 0, len(code), reg, n, tables, phi, curve[here % len(curve)])
            for at in range(len(outputs)):
                found[at, here, first : first + n] = reg[outputs[at], :n]
            for block in range(blocks):
                there = block * rows + row
                _load(own[its_own[block] : its_own[block + 1]], points, feet, there, which, reg)
                _run(lines, its_lines[block], its_lines[block + 1], reg, n, tables, phi, curve[there % len(curve)])
                for at in range(len(outputs)):
                    found[at, there, first : first + n] = reg[results[block, at], :n]
    return found


@_compiled
def _load_kind(inputs, kind, values, reg):
    """Load the inputs of one kind into their registers, the same at all points."""
    for at in range(len(inputs)):
        if inputs[at, 1] == kind:
            reg[inputs[at, 0]] = values[inputs[at, 2]]


@_compiled
def _margins(program, moved, points, depth, pairs, depths, rows):
    """The margin at ``depths (pairs, 2, n)`` of both nodes of each pair ``(blocks, pairs, 2, n)``; ``pairs`` are rows,
    cells and softer nodes. ``depth`` is the register of the depth.

    Blocks of ``rows`` rows as in ``evaluate_moved``: in the last one nothing is moved.
    """
    code, inputs, outputs, count, constants, tables = program
    lines, its_lines, own, its_own, results = moved
    row, cell, below = pairs
    theta, conditions, k, phi, curve = points
    n, blocks, last = depths.shape[2], len(results), len(theta) - rows
    reg, found = _registers(2 * count, 2 * n, constants), np.empty((blocks + 1, *depths.shape))
    for i in range(len(row)):
        for node in range(2):
            reg[depth, node * n : (node + 1) * n] = depths[i, node]
        for block in range(-1, blocks):
            at = row[i] + (last if block < 0 else block * rows)
            these = inputs if block < 0 else own[its_own[block] : its_own[block + 1]]
            _load_kind(these, OF_ROW, theta[at], reg)
            if block < 0:
                _load_kind(these, OF_CELL, conditions[:, at % conditions.shape[1], cell[i]], reg)
            for node in range(2):
                its = k[at % k.shape[0], cell[i] % k.shape[1], below[i] + node :]
                _load_kind(these, OF_NODE, its, reg[:, node * n : (node + 1) * n])
            if block < 0:
                _run(code, 0, len(code), reg, 2 * n, tables, phi, curve[at % len(curve)])
            else:
                _run(lines, its_lines[block], its_lines[block + 1], reg, 2 * n, tables, phi, curve[at % len(curve)])
            margin = reg[outputs[0] if block < 0 else results[block, 0]]
            found[block, i, 0], found[block, i, 1] = margin[:n], margin[n:]
    return found


@_compiled
def _margins_on(scan, levels, points, depth, pairs, grid):
    """The same at the depths of a ``grid``, by a program sorted as in ``footing``: what consecutive pairs, ordered by
    row and cell, have in common is done once."""
    code, inputs, outputs, count, constants, tables = scan
    row, cell, below = pairs
    theta, conditions, k, phi, curve = points
    n = len(grid)
    reg, found = _registers(count, n, constants), np.empty((len(row), 2, n))
    reg[depth] = grid
    _run(code, 0, levels[0], reg, n, tables, phi, curve[0])
    for i in range(len(row)):
        own, its = curve[row[i] % len(curve)], k[row[i] % k.shape[0], cell[i] % k.shape[1]]
        other_row = i == 0 or row[i] != row[i - 1]
        if other_row:
            _load_kind(inputs, OF_ROW, theta[row[i]], reg)
            _run(code, levels[0], levels[1], reg, n, tables, phi, own)
        if other_row or cell[i] != cell[i - 1]:
            _load_kind(inputs, OF_CELL, conditions[:, row[i] % conditions.shape[1], cell[i]], reg)
            _run(code, levels[1], levels[2], reg, n, tables, phi, own)
        for node in range(2):
            _load_kind(inputs, OF_NODE, its[below[i] + node :], reg)
            _run(code, levels[2], len(code), reg, n, tables, phi, own)
            found[i, node] = reg[outputs[0]]
    return found


@_compiled
def switches(scan, levels, plain, unmoved, points, depth, pairs, stands, grid, window):
    """Those of ``pairs`` of nodes (rows, cells, softer nodes) between which legs jump, the depths about the maxima of
    their margins, and where between the nodes k becomes sufficient; see ``tops`` and ``suffices``. Programs as in
    ``footing``; ``depth`` is the register of the depth."""
    row, cell, below = pairs
    top, jumps = tops(_margins_on(scan, levels, points, depth, pairs, grid), grid, stands)
    some = np.nonzero(jumps)[0]
    pairs, depths = (row[some], cell[some], below[some]), about(top[some], grid, window)
    return pairs, depths, suffices(_margins(plain[0], unmoved, points, depth, pairs, depths, len(points[0]))[0], depths)


@_compiled
def places(program, moved, points, depth, pairs, depths, rows):
    """Where k becomes sufficient between given pairs, in each block of ``rows`` rows ``(blocks, pairs)``."""
    margins = _margins(program, moved, points, depth, pairs, depths, rows)
    found = np.empty(margins.shape[:2])
    for block in range(len(found)):
        found[block] = suffices(margins[block], depths)
    return found


@_compiled
def about(top, grid, window):
    """Depths at the offsets ``window`` (in grid steps) about grid indices ``top (pairs, 2)``, interpolated."""
    found, last = np.empty((*top.shape, len(window))), len(grid) - 1
    for i in range(len(top)):
        for node in range(2):
            for at in range(len(window)):
                place = min(max(top[i, node] + window[at], 0.0), float(last))
                below = min(int(place), last - 1)
                found[i, node, at] = (grid[below + 1] - grid[below]) * (place - below) + grid[below]
    return found


@_compiled
def tops(margins, depths, stands):
    """Where each margin is highest before the softer node holds, as index ``(pairs, 2)``, and whether the stiffer node
    holds there, so that legs jump, rather than depth merely changing fast. ``margins (pairs, 2, depths)`` are those of
    a softer and a stiffer node; the latter stands at ``stands (pairs,)``."""
    pairs, last = len(margins), len(depths) - 1
    found, jumps = np.zeros((pairs, 2), dtype=np.int64), np.zeros(pairs, dtype=np.bool_)
    for i in range(pairs):
        margin, top, holds = margins[i, 0], -1, last + 1
        for at in range(last + 1):
            if margin[at] >= 0:
                holds = at
                break
            if (at == 0 or margin[at] > margin[at - 1]) and (at == last or margin[at] >= margin[at + 1]):
                top = at if top < 0 or margin[at] > margin[top] else top
        if top >= 0:
            valley = last if holds > last else top + 1 + np.argmin(margin[top + 1 : holds])
            found[i, 0], found[i, 1] = top, np.argmax(margins[i, 1, : valley + 1])
            jumps[i] = stands[i] <= depths[valley]
    return found, jumps


@_compiled
def suffices(margins, depths):
    """Where between a softer and a stiffer node k becomes sufficient (0 to 1), from their ``margins (pairs, 2, n)`` at
    ``depths`` about their maxima."""
    part = np.empty(len(margins))
    for i in range(len(margins)):
        least, most = min(_height(margins[i, 0], depths[i, 0]), 0.0), _height(margins[i, 1], depths[i, 1])
        part[i] = min(-least / (most - least), 1.0) if most > least else 1.0
    return part


@_compiled
def _height(margin, depths):
    """Maximum of a margin. With disturbed ground it is a kink, found by extending the lines from both sides."""
    top, last = np.argmax(margin), len(margin) - 1
    found = margin[top]
    for left in (top - 1, top):
        if left < 1 or left + 2 > last:
            continue
        a, b, c, d = depths[left - 1], depths[left], depths[left + 1], depths[left + 2]
        up, down = (margin[left] - margin[left - 1]) / (b - a), (margin[left + 2] - margin[left + 1]) / (d - c)
        if up > 0 and down < 0:
            ridge = (margin[left + 1] - margin[left] + up * b - down * c) / (up - down)
            if b <= ridge <= c:
                found = max(found, margin[left] + up * (ridge - b))
    return found


@_compiled
def footing(scan, levels, plain, points, depth, grid, steps, rises, held):
    """Depth and whether the ground holds at all, ``(rows, cells * nodes)``.

    The margin is evaluated on a grid of depths by the program ``scan``, whose lines that depend on row, cell and node
    begin at ``levels``. Its first crossing of 0 is refined by ``steps`` of the Illinois rule with ``plain``, a program
    and where its lines that depend on the depth begin. Before that crossing a peak below 0 may reach 0 between the
    grid's depths (see ``Walker``).
    """
    upper, (peak, first, second) = _bracket(scan, levels, points, depth, grid)
    found, walking = _polish(plain, points, depth, grid, upper, steps), upper > 0
    if peak.any():
        _follow_rises(plain, points, depth, grid, peak, first, second, rises, held, found, walking)
    return found, walking


@_compiled
def _bracket(program, levels, points, depth, grid):
    """Grid index at which the margin first is not negative, 0 if nowhere.

    Also that of the highest peak below 0 before it, and the margins at the two depths that lead up to that peak.
    """
    code, inputs, outputs, count, constants, tables = program
    theta, conditions, k, phi, curve = points
    rows, cells, nodes = len(theta), conditions.shape[2], k.shape[2]
    n, margin, stiffness = len(grid), outputs[0], _register_of(inputs, OF_NODE)
    reg = _registers(count, n, constants)
    reg[depth] = grid
    upper, peak = np.zeros((rows, cells * nodes), dtype=np.int64), np.zeros((rows, cells * nodes), dtype=np.int64)
    first, second = np.zeros((2, rows, cells * nodes))
    order, repeats = np.arange(cells), np.zeros(cells, dtype=np.bool_)
    outermost_first = np.roll(np.arange(nodes), 1)
    _run(code, 0, levels[0], reg, n, tables, phi, curve[0])
    for row in range(rows):
        own = curve[row % len(curve)]
        _load_kind(inputs, OF_ROW, theta[row], reg)
        _run(code, levels[0], levels[1], reg, n, tables, phi, own)
        if row < conditions.shape[1]:
            _group_equal_cells(inputs, conditions[:, row], order, repeats)
        for at in range(cells):
            cell = order[at]
            if not repeats[at]:
                _load_kind(inputs, OF_CELL, conditions[:, row % conditions.shape[1], cell], reg)
                _run(code, levels[1], levels[2], reg, n, tables, phi, own)
            row_k, cell_k = row % k.shape[0], cell % k.shape[1]
            least, most = cell * nodes, cell * nodes + nodes - 1
            for node in outermost_first:
                point = least + node
                agree = upper[row, least] == upper[row, most] and peak[row, least] + peak[row, most] == 0
                if 0 < node < nodes - 1 and agree:
                    # k grows from node to node, and stiffer ground never holds at a greater depth: where the outermost
                    # nodes agree, so do those between them.
                    upper[row, point] = upper[row, least]
                    continue
                if stiffness >= 0:
                    for i in range(n):
                        reg[stiffness, i] = k[row_k, cell_k, node]
                _run(code, levels[2], len(code), reg, n, tables, phi, own)
                held, top = _crossing_and_peak(reg[margin])
                if held < n:
                    upper[row, point] = max(held, 1)
                if top:
                    before = max(top - 1, 1)
                    peak[row, point] = top
                    first[row, point], second[row, point] = reg[margin, before - 1], reg[margin, before]
    return upper, (peak, first, second)


@_compiled
def _register_of(inputs, kind):
    """Register of the last input of a kind, -1 if there is none."""
    found = -1
    for at in range(len(inputs)):
        if inputs[at, 1] == kind:
            found = inputs[at, 0]
    return found


@_compiled
def _group_equal_cells(inputs, conditions, order, repeats):
    """Fill ``order`` so that cells with equal inputs in ``conditions (columns, cells)`` follow each other, and
    ``repeats (cells,)`` with whether each equals the one before."""
    placed, count = np.zeros(len(order), dtype=np.bool_), 0
    for first in range(len(order)):
        if not placed[first]:
            begin = count
            for cell in range(first, len(order)):
                if _same(inputs, conditions, first, cell):
                    order[count], repeats[count], placed[cell] = cell, count > begin, True
                    count += 1


@_compiled
def _same(inputs, conditions, cell, other):
    for at in range(len(inputs)):
        if inputs[at, 1] == OF_CELL and conditions[inputs[at, 2], cell] != conditions[inputs[at, 2], other]:
            return False
    return True


@_compiled
def _crossing_and_peak(margin):
    """Index at which it first is not negative (its length if nowhere) and of its highest peak before (0 if none)."""
    held, last, top = 0, len(margin) - 1, 0
    while held <= last and not margin[held] >= 0:
        held += 1
    for at in range(1, min(held, last)):
        here = margin[at]
        if here > margin[at - 1] and here >= margin[at + 1] and (top == 0 or here > margin[top]):
            top = at
    return held, top


@_compiled
def _polish(program, points, depth, grid, upper, steps):
    """Depth of the crossing within its bracket, the greatest depth where there is none."""
    (code, inputs, outputs, count, constants, tables), first_moved = program
    phi, curve = points[3], points[4]
    reg, none = _registers(count, BLOCK, constants), np.empty((0, 0, 0))
    found = np.full(upper.shape, grid[-1])
    low, high, below, above = np.empty((4, BLOCK))
    for row in range(len(upper)):
        crossing = np.nonzero(upper[row])[0]
        for begin in range(0, len(crossing), BLOCK):
            which = crossing[begin : begin + BLOCK]
            n = len(which)
            _load(inputs, points, none, row, which, reg)
            _run(code, 0, first_moved, reg, n, tables, phi, curve[row % len(curve)])
            for i in range(n):
                low[i], high[i] = grid[upper[row, which[i]] - 1], grid[upper[row, which[i]]]
            for end, margin in ((low, below), (high, above)):
                reg[depth, :n] = end[:n]
                _run(code, first_moved, len(code), reg, n, tables, phi, curve[row % len(curve)])
                margin[:n] = reg[outputs[0], :n]
            for _ in range(steps):
                for i in range(n):
                    reg[depth, i] = _secant(low[i], high[i], below[i], above[i])
                _run(code, first_moved, len(code), reg, n, tables, phi, curve[row % len(curve)])
                for i in range(n):
                    here = reg[outputs[0], i]
                    # Illinois rule: halve the margin of the retained end, so that it is not retained for ever.
                    if here >= 0:
                        high[i], above[i] = reg[depth, i], here
                        below[i] *= 0.5
                    else:
                        low[i], below[i] = reg[depth, i], here
                        above[i] *= 0.5
            for i in range(n):
                found[row, which[i]] = _secant(low[i], high[i], below[i], above[i])
    return found


@_compiled
def _follow_rises(program, points, depth, grid, peak, first, second, steps, held, found, walking):
    """Enter the depths at which the margin reaches 0 as it rises to a peak, see ``Walker._on_a_rise``."""
    (code, inputs, outputs, count, constants, tables), first_moved = program
    phi, curve = points[3], points[4]
    reg, none = _registers(count, BLOCK, constants), np.empty((0, 0, 0))
    low, here = np.empty(BLOCK), np.empty(BLOCK)
    for row in range(len(peak)):
        peaked = np.nonzero(peak[row])[0]
        for begin in range(0, len(peaked), BLOCK):
            which = peaked[begin : begin + BLOCK]
            n = len(which)
            _load(inputs, points, none, row, which, reg)
            _run(code, 0, first_moved, reg, n, tables, phi, curve[row % len(curve)])
            for i in range(n):
                before = max(peak[row, which[i]] - 1, 1)
                low[i], here[i], reg[depth, i] = grid[before - 1], second[row, which[i]], grid[before]
            for _ in range(steps):
                for i in range(n):
                    top, now = peak[row, which[i]], reg[depth, i]
                    beyond = _extrapolated(low[i], now, first[row, which[i]], here[i])
                    if abs(here[i]) >= held and beyond <= grid[min(top + 1, len(grid) - 1)]:
                        low[i], first[row, which[i]], reg[depth, i] = now, here[i], beyond
                _run(code, first_moved, len(code), reg, n, tables, phi, curve[row % len(curve)])
                here[:n] = reg[outputs[0], :n]
            for i in range(n):
                if abs(here[i]) < held:
                    found[row, which[i]], walking[row, which[i]] = reg[depth, i], True


@_compiled
def _extrapolated(low, high, below, above):
    rise = above - below
    return low - below / rise * max(high - low, 1e-9) if rise > 0 else np.inf


@_compiled
def _secant(low, high, below, above):
    rise = above - below
    share = -below / rise if rise > 0 else 0.5
    return low + min(max(share, 0.0), 1.0) * (high - low)
