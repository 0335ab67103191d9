"""The compiled inner loops of a fit: footing and prediction of all cells, their likelihood, its derivatives.

``likelihood`` and ``jacobian`` explain the quantities. Arrays are ``(rows, cells, nodes, ...)``; nodes are those of
``averaging``.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import math

import numpy as np

from sandbot_common.compiled import compiled
from sandbot_model.physics import machine
from sandbot_model.physics.averaging import REACHED
from sandbot_model.physics.observables import Observable

_compiled = compiled(nogil=True, error_model="numpy")

OBSERVABLES = len(Observable)
LIFT, PEAK_SPEED, FIRST_STEP = int(Observable.lift), int(Observable.peak_speed), int(Observable.first_step)


@_compiled
def node_k(level_k, slope, level, factor, sigma_phi, ln_k_sd, nodes, least_spread):
    """k of every node ``(rows, cells, nodes)`` for k and dk/dφ ``(rows, levels)``, σ_φ ``(rows or 1, cells)``; a cell's
    k is that of its level times ``factor (rows or 1, cells)``."""
    found = np.empty((len(level_k), len(level), len(nodes)))
    for row in range(len(level_k)):
        for cell in range(len(level)):
            k = level_k[row, level[cell]] * factor[row % len(factor), cell]
            sigma = max(abs(slope[row, level[cell]]) * sigma_phi[row % len(sigma_phi), cell], least_spread * k)
            if ln_k_sd[cell] > 0:
                sigma = math.hypot(sigma, ln_k_sd[cell] * k)
            for node in range(len(nodes)):
                found[row, cell, node] = max(k + sigma * nodes[node], 0.05 * k)
    return found


@_compiled
def cell_likelihood(values, walking, plain, weights, between, data, share, replicates):
    """Mean ``(rows, cells, 4)``, covariance, its whitening ``(..., 4, 4)``, whitened residual, deviance of each cell.

    ``values (4, rows, cells, nodes)`` are weighted by ``weights (rows, cells, nodes, 4 or 1)`` in the mean and by
    ``between (rows, cells, nodes)`` in its variance. The scatter of the nodes is added to the variance where a cell is
    mixed: some nodes are ``walking`` and some not, or their weights are not the ``plain`` ones ``(nodes,)``.
    """
    measured, mean, covariance, whiten, log_det = data
    _, rows, cells, count = values.shape
    each = weights.shape[3] > 1
    predicted, residual = np.zeros((2, rows, cells, OBSERVABLES))
    deviance, (wider, whitens) = np.empty((rows, cells)), np.empty((2, rows, cells, OBSERVABLES, OBSERVABLES))
    for row in range(rows):
        for cell in range(cells):
            walks, mixed = 0, False
            for node in range(count):
                for i in range(OBSERVABLES):
                    weight = weights[row, cell, node, i if each else 0]
                    predicted[row, cell, i] += weight * values[i, row, cell, node]
                walks += walking[row, cell, node]
                mixed |= between[row, cell, node] != plain[node]
            for i in range(OBSERVABLES):
                for j in range(OBSERVABLES):
                    wider[row, cell, i, j], whitens[row, cell, i, j] = covariance[cell, i, j], whiten[cell, i, j]
            deviance[row, cell] = 0.0
            if mixed or 0 < walks < count:
                of = share[row % len(share), cell % share.shape[1]], replicates[row % len(replicates), cell]
                spread = values[:, row, cell], predicted[row, cell], between[row, cell]
                here = measured[cell], wider[row, cell], whitens[row, cell]
                deviance[row, cell] = _widen(spread, of, here) - log_det[cell]
            for i in range(OBSERVABLES):
                for j in range(i + 1):
                    if measured[cell, j]:
                        residual[row, cell, i] += whitens[row, cell, i, j] * (mean[cell, j] - predicted[row, cell, j])
                deviance[row, cell] += residual[row, cell, i] ** 2
    return predicted, wider, whitens, residual, deviance


@_compiled
def _widen(spread, of, here):
    """Add the scatter of a cell's nodes to its covariance, update the whitening, return ln |covariance|."""
    values, mean, weights = spread
    share, replicates = of
    measured, covariance, whiten = here
    for i in range(OBSERVABLES):
        for j in range(i + 1):
            if measured[i] and measured[j]:
                between = 0.0
                for node in range(len(weights)):
                    own, other = values[i, node] - mean[i], values[j, node] - mean[j]
                    between += weights[node] * (share[i] * own * share[j] * other)
                covariance[i, j] += between / replicates
                covariance[j, i] = covariance[i, j]
    root = np.zeros((OBSERVABLES, OBSERVABLES))
    log_det = 0.0
    for i in range(OBSERVABLES):
        for j in range(i + 1):
            rest = covariance[i, j]
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(rest) if i == j else rest / root[j, j]
        log_det += 2 * math.log(root[i, i])
    for j in range(OBSERVABLES):
        for i in range(OBSERVABLES):
            rest = 1.0 if i == j else 0.0
            for k in range(j, i):
                rest -= root[i, k] * whiten[k, j]
            whiten[i, j] = rest / root[i, i] if i >= j else 0.0
    return log_det


@_compiled
def with_reading_errors(given, unit, measured, without):
    """Apply zero offsets and scale errors of the readings: their values ``(rows, m)``, means, residuals, deviances.

    The values, in units of their priors, are those ``given`` or, where NaN, the most likely ones. They move cell means
    by ``unit (cells, 4, m)``; ``without`` are the whitening, means, residuals and deviances without them (see
    ``cell_likelihood``).
    """
    whiten, mean, residual, deviance = without
    (rows, count), cells = given.shape, len(unit)
    found, mean, residual, deviance = given.copy(), mean.copy(), residual.copy(), deviance.copy()
    shift, normal, pull = np.zeros(unit.shape), np.empty((count, count)), np.empty(count)
    its, many = _columns_of_cells(unit)
    for row in range(rows):
        unknown = False
        for n in range(count):
            unknown |= math.isnan(given[row, n])
        normal[:], pull[:] = 0.0, 0.0
        _whiten_columns(row, unit, its, many, measured, whiten, shift)
        if unknown:
            _add_normal(row, shift, its, many, residual, normal, pull)
            for n in range(count):
                normal[n, n] += 1.0
            found[row] = np.linalg.solve(normal, pull)
        for cell in range(cells):
            for i in range(OBSERVABLES):
                before = residual[row, cell, i]
                for at in range(many[cell]):
                    n = its[cell, at]
                    residual[row, cell, i] -= shift[cell, i, n] * found[row, n]
                    mean[row, cell, i] += unit[cell, i, n] * found[row, n]
                deviance[row, cell] += residual[row, cell, i] ** 2 - before**2
    return found, mean, residual, deviance


@_compiled
def _columns_of_cells(slope):
    """Which columns of slopes ``(cells, 4, m)`` move a cell: the first ``many (cells,)`` of ``its (cells, m)``. Most do
    not: a nuisance of one day moves no cell of another."""
    cells, _, count = slope.shape
    its, many = np.empty((cells, count), dtype=np.int64), np.zeros(cells, dtype=np.int64)
    for cell in range(cells):
        for n in range(count):
            if slope[cell, 0, n] != 0 or slope[cell, 1, n] != 0 or slope[cell, 2, n] != 0 or slope[cell, 3, n] != 0:
                its[cell, many[cell]] = n
                many[cell] += 1
    return its, many


@_compiled
def _whiten_columns(row, unit, its, many, measured, whiten, shift):
    """Whiten the columns ``its`` of every cell's slopes ``(4, m)``."""
    # A slice of an array for each cell would cost more, in counting references, than the arithmetic.
    for cell in range(len(unit)):
        for at in range(many[cell]):
            n = its[cell, at]
            for i in range(OBSERVABLES):
                shift[cell, i, n] = 0.0
                for j in range(i + 1):
                    if measured[cell, j]:
                        shift[cell, i, n] += whiten[row, cell, i, j] * unit[cell, j, n]


@_compiled
def _add_normal(row, shift, its, many, residual, normal, pull):
    """Add every cell to the normal equations."""
    for cell in range(len(shift)):
        for i in range(OBSERVABLES):
            for at in range(many[cell]):
                n = its[cell, at]
                pull[n] += shift[cell, i, n] * residual[row, cell, i]
                for other in range(many[cell]):
                    m = its[cell, other]
                    normal[n, m] += shift[cell, i, n] * shift[cell, i, m]


@_compiled
def local_jacobian(seen, steps, walking, virgin_walking, weights, measured, whiten):
    """d(whitened prediction)/d(θ, ln k) ``(rows, cells, 4, parameters + 1)``.

    ``seen (6, parameters + 3, rows, cells, nodes)`` are the observables and margins with each parameter, ln k and the
    depth moved in turn by ``steps (parameters + 2, rows)``, and last with nothing moved.
    """
    count, (rows, cells, nodes), each = len(steps) - 1, walking.shape, weights.shape[3] > 1
    found = np.zeros((rows, cells, OBSERVABLES, count))
    slope, by_depth, stiff, sinks = np.empty((count, OBSERVABLES)), np.empty(OBSERVABLES), np.empty(2), np.empty(2)
    for row in range(rows):
        for cell in range(cells):
            weight = weights[row, cell]
            slope[:] = 0.0
            for node in range(nodes):
                holds = walking[row, cell, node], virgin_walking[row, cell, node]
                unmoved, at_depth = seen[:, count + 1, row, cell, node], seen[:, count, row, cell, node]
                for i in range(OBSERVABLES):
                    by_depth[i] = (at_depth[i] - unmoved[i]) / steps[count, row]
                for step in range(2):
                    stiff[step] = (at_depth[OBSERVABLES + step] - unmoved[OBSERVABLES + step]) / steps[count, row]
                for p in range(count):
                    values = seen[:, p, row, cell, node]
                    for step in range(2):
                        # By dd/dθ = -(∂M/∂θ)/(∂M/∂d); a depth at a jump of the margin does not move.
                        pull = (values[OBSERVABLES + step] - unmoved[OBSERVABLES + step]) / steps[p, row]
                        sinks[step] = -pull / stiff[step] if holds[step] and stiff[step] > 1e-6 else 0.0
                    for i in range(OBSERVABLES):
                        direct = (values[i] - unmoved[i]) / steps[p, row]
                        by_sinking = by_depth[i] * sinks[1 if i == FIRST_STEP else 0]
                        slope[p, i] += weight[node, i if each else 0] * (direct + by_sinking)
            _whitened_slopes(slope, measured[cell], whiten[row, cell], found[row, cell])
    return found


@_compiled
def _whitened_slopes(slope, measured, whiten, found):
    for i in range(OBSERVABLES):
        for j in range(i + 1):
            if measured[j]:
                for p in range(len(slope)):
                    found[i, p] += whiten[i, j] * slope[p, j]


@_compiled
def damped_step(jacobian, residual, theta, low, high, free, damping):
    """Levenberg-Marquardt step of each row ``(rows, unknowns)``, with Marquardt's scaling.

    Parameters (the first of the unknowns) that are not ``free`` or are pressed against a bound do not move.
    """
    rows, _, unknowns = jacobian.shape
    found = np.empty((rows, unknowns))
    for row in range(rows):
        transposed = np.ascontiguousarray(jacobian[row].T)
        gradient, normal = transposed @ residual[row], transposed @ jacobian[row]
        scale = np.maximum(np.sqrt(np.diag(normal)), 1e-9)
        for p in range(unknowns):
            gradient[p] /= scale[p]
            for q in range(unknowns):
                normal[p, q] = normal[p, q] / scale[p] / scale[q]
        for p in range(theta.shape[1]):
            ends = (theta[row, p] <= low[p] and gradient[p] < 0) or (theta[row, p] >= high[p] and gradient[p] > 0)
            if ends or not free[p]:
                normal[p], normal[:, p], normal[p, p], gradient[p] = 0.0, 0.0, 1.0, 0.0
        for p in range(unknowns):
            normal[p, p] += damping[row]
        found[row] = np.linalg.solve(normal, gradient) / scale
    return found


@_compiled
def spread(local, level, levels):
    """Expand ``local_jacobian`` to a column for ln k of each level, ``(rows, 4 cells, parameters + levels)``."""
    rows, cells, _, count = local.shape
    found = np.zeros((rows, OBSERVABLES * cells, count - 1 + levels))
    for row in range(rows):
        for cell in range(cells):
            for i in range(OBSERVABLES):
                for p in range(count - 1):
                    found[row, OBSERVABLES * cell + i, p] = local[row, cell, i, p]
                found[row, OBSERVABLES * cell + i, count - 1 + level[cell]] = local[row, cell, i, count - 1]
    return found


@_compiled
def profiled(table, condition, data, level, k_grid, sigma_k, nodes, weights, same, cross):
    """Least deviance over k for each θ ``(m,)``, and the minimising k ``(m, levels)``.

    ``table (4, m, φ, conditions, k)`` are predictions, averaged along a cell's track with σ_k ``(m, cells)``.
    Adds to the sums ``same`` and ``cross`` (see ``starts``).
    """
    measured, mean, _, whiten, _ = data
    deviance, k = np.zeros(len(same)), np.empty(same.shape[:2])
    residual, last = np.empty((2, OBSERVABLES))
    for row in range(len(same)):
        for cell in range(len(level)):
            of = table[:, row, level[cell] if table.shape[2] > 1 else 0, condition[cell]]
            if sigma_k[row, cell] > 0:
                of = _track_average(of, k_grid, sigma_k[row, cell], nodes, weights)
            for at in range(len(k_grid)):
                for i in range(OBSERVABLES):
                    last[i], residual[i] = residual[i], 0.0
                    for j in range(i + 1):
                        if measured[cell, j]:
                            residual[i] += whiten[cell, i, j] * (mean[cell, j] - of[j, at])
                    same[row, level[cell], at] += residual[i] ** 2
                    if at:
                        cross[row, level[cell], at - 1] += residual[i] * last[i]
        for at in range(same.shape[1]):
            least, k[row, at] = _least(same[row, at], cross[row, at], k_grid)
            deviance[row] += least
    return deviance, k


@_compiled
def _least(same, cross, k_grid):
    """Minimum over the parabolas between neighbouring grid nodes, and k there."""
    least, k = np.inf, 0.0
    for at in range(len(cross)):
        low, high = same[at], same[at + 1]
        bend = low - 2 * cross[at] + high
        t = min(max((low - cross[at]) / bend, 0.0), 1.0) if bend > 1e-12 else 0.0
        value = (1 - t) ** 2 * low + 2 * t * (1 - t) * cross[at] + t**2 * high
        if value < least:
            least, k = value, k_grid[at] * (1 - t) + k_grid[at + 1] * t
    return least, k


@_compiled
def _track_average(table, k_grid, sigma, nodes, weights):
    """A cell's predictions ``(4, k)`` averaged along the track; lift is the median step's, peak the best step's."""
    found = np.zeros(table.shape)
    for at in range(len(k_grid)):
        found[LIFT, at], found[PEAK_SPEED, at] = table[LIFT, at], -np.inf
        for node in range(len(nodes)):
            wanted = min(max(k_grid[at] + sigma * nodes[node], k_grid[0]), k_grid[-1])
            upper = min(max(np.searchsorted(k_grid, wanted), 1), len(k_grid) - 1)
            share = (wanted - k_grid[upper - 1]) / (k_grid[upper] - k_grid[upper - 1])
            for i in range(OBSERVABLES):
                value = (1 - share) * table[i, upper - 1] + share * table[i, upper]
                if i == PEAK_SPEED and abs(nodes[node]) < REACHED:
                    found[i, at] = max(found[i, at], value)
                elif i != LIFT and i != PEAK_SPEED:
                    found[i, at] += weights[node] * value
    return found


@_compiled
def footing_and_values(steady, virgin, seen, points, grid, independent, search, quadrature):
    """Depths and whether the ground holds, steady and on virgin ground ``(rows, cells * nodes)``, the observables there
    ``(4, rows, cells * nodes)``, and each node's fraction of a cell's trials ``(rows, cells, nodes)``.

    ``steady`` and ``virgin`` are a margin's programs (see ``machine.switches``) with the register of its depth, both
    the same where the first step is like the others; ``seen`` is the program of the observables. Fractions are those of
    the ``quadrature`` except where legs jump between nodes of ``independent (rows or 1, cells)`` cells.
    """
    polish, rises, held, drop, window = search
    nodes, weights, edges = quadrature
    shape = len(points[0]), points[1].shape[2], points[2].shape[2]
    depth, walking = machine.footing(*steady[:3], points, steady[4], grid, polish, rises, held)
    remembers, virgin_depth, virgin_walking = steady[4] != virgin[4], depth, walking
    if remembers:
        virgin_depth, virgin_walking = machine.footing(*virgin[:3], points, virgin[4], grid, polish, rises, held)
    feet = np.empty((4, *depth.shape))
    feet[0], feet[1], feet[2], feet[3] = depth, walking, virgin_depth, virgin_walking
    values = machine.evaluate(seen, points, feet)
    share, taken = np.empty(shape), np.zeros(shape, dtype=np.bool_)
    share[:] = weights
    for step in range(2 if remembers else 1):
        stands = (virgin_depth if step else depth).reshape(shape)
        pairs = candidate_pairs(stands, (virgin_walking if step else walking).reshape(shape), independent, drop)
        if len(pairs[0]):
            stiffer = np.empty(len(pairs[0]))
            for i in range(len(stiffer)):
                stiffer[i] = stands[pairs[0][i], pairs[1][i], pairs[2][i] + 1]
            its = virgin if step else steady
            (row, cell, below), _, part = machine.switches(*its[:4], points, its[4], pairs, stiffer, grid, window)
            for i in range(len(row)):
                # Of two switches between the same nodes the steady gait's is kept: more observables depend on it.
                if not taken[row[i], cell[i], below[i]]:
                    at = nodes[below[i]] + part[i] * (nodes[below[i] + 1] - nodes[below[i]])
                    _shift_edge(share[row[i], cell[i]], edges, below[i], at)
                if not step:
                    taken[row[i], cell[i], below[i]] = True
    return depth, walking, virgin_depth, virgin_walking, values, share


@_compiled
def candidate_pairs(depth, walking, independent, drop):
    """Neighbouring nodes between which there may be a switch: the softer stands deeper by more than ``drop``, or alone
    does not walk. Their rows, cells and softer nodes, of ``independent (rows or 1, cells)`` cells."""
    rows, cells, nodes = depth.shape
    found = np.empty((3, rows * cells * (nodes - 1)), dtype=np.int64)
    count = 0
    for row in range(rows):
        for cell in range(cells):
            if independent[row % len(independent), cell % independent.shape[1]]:
                for node in range(nodes - 1):
                    soft, stiff = walking[row, cell, node], walking[row, cell, node + 1]
                    if depth[row, cell, node] - depth[row, cell, node + 1] > drop or (stiff and not soft):
                        found[0, count], found[1, count], found[2, count] = row, cell, node
                        count += 1
    return found[0, :count].copy(), found[1, :count].copy(), found[2, :count].copy()


@_compiled
def shift_edges(share, edges, row, cell, below, at):
    """Move edges between the nodes' parts of the normal distribution; updates ``share (rows, cells, nodes)``."""
    for i in range(len(row)):
        _shift_edge(share[row[i], cell[i]], edges, below[i], at[i])


@_compiled
def _shift_edge(share, edges, below, at):
    more = _normal(at) - _normal(edges[below])
    share[below] += more
    share[below + 1] -= more


@_compiled
def add_switch_slopes(local, whiten, measured, values, pairs, at, by, fixed):
    """Add to ``local_jacobian`` the effect of moving switches, which transfers trials from the stiffer node to the
    softer. ``at (switches,)`` [σ of k] move by ``by (parameters + 1, switches)``; observables ``fixed (4,)`` are not
    averages over nodes and do not change."""
    row, cell, below = pairs
    for s in range(len(row)):
        density = math.exp(-0.5 * at[s] ** 2) / math.sqrt(2 * math.pi)
        of = values[:, row[s], cell[s]]
        for j in range(OBSERVABLES):
            if measured[cell[s], j] and not fixed[j]:
                change = density * (of[j, below[s]] - of[j, below[s] + 1])
                for i in range(j, OBSERVABLES):
                    for p in range(len(by)):
                        local[row[s], cell[s], i, p] += whiten[row[s], cell[s], i, j] * change * by[p, s]


@_compiled
def _normal(x):
    return 0.5 * math.erfc(-x / math.sqrt(2.0))
