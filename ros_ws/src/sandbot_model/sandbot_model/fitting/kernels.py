"""What every step of a fit computes, compiled: footing and prediction of all cells, their likelihood, its derivatives.

``likelihood`` and ``jacobian`` say what is meant. Arrays are ``(rows, cells, nodes, ...)``; nodes are those of
``averaging``.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

import math

import numba
import numpy as np

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def node_k(level_k, slope, level, sigma_phi, ln_k_sd, nodes, least_spread):
    """k of every node ``(rows, cells, nodes)`` for k and dk/dφ ``(rows, levels)``, σ_φ ``(rows or 1, cells)``."""
    found = np.empty((len(level_k), len(level), len(nodes)))
    for row in range(len(level_k)):
        for cell in range(len(level)):
            k = level_k[row, level[cell]]
            sigma = max(abs(slope[row, level[cell]]) * sigma_phi[row % len(sigma_phi), cell], least_spread * k)
            if ln_k_sd[cell] > 0:
                sigma = math.hypot(sigma, ln_k_sd[cell] * k)
            for node in range(len(nodes)):
                found[row, cell, node] = max(k + sigma * nodes[node], 0.05 * k)
    return found


@_compiled
def judged(values, walking, weights, between, data, share, replicates):
    """Mean ``(rows, cells, 4)``, covariance, its whitening ``(..., 4, 4)``, whitened residual, deviance of each cell.

    ``weights (rows or 1, cells or 1, nodes, 4)`` are the nodes' in the mean, ``between (nodes,)`` in its variance.
    """
    measured, mean, covariance, whiten, log_det = data
    rows, cells, count, _ = values.shape
    predicted, residual, deviance = np.zeros((rows, cells, 4)), np.zeros((rows, cells, 4)), np.empty((rows, cells))
    wider, whitens = np.empty((rows, cells, 4, 4)), np.empty((rows, cells, 4, 4))
    gap = np.empty(4)
    for row in range(rows):
        for cell in range(cells):
            weight, walks, change = weights[row % len(weights), cell % weights.shape[1]], 0, 0.0
            for node in range(count):
                walks += walking[row, cell, node]
                for i in range(4):
                    predicted[row, cell, i] += weight[node, i] * values[row, cell, node, i]
            wider[row, cell], whitens[row, cell] = covariance[cell], whiten[cell]
            if 0 < walks < count:
                deviation = share[row % len(share), cell % share.shape[1]] * (values[row, cell] - predicted[row, cell])
                n = replicates[row % len(replicates), cell]
                change = (
                    _widen(deviation, between, measured[cell], n, wider[row, cell], whitens[row, cell]) - log_det[cell]
                )
            for i in range(4):
                gap[i] = mean[cell, i] - predicted[row, cell, i] if measured[cell, i] else 0.0
            for i in range(4):
                for j in range(i + 1):
                    residual[row, cell, i] += whitens[row, cell, i, j] * gap[j]
            deviance[row, cell] = np.sum(residual[row, cell] ** 2) + change
    return predicted, wider, whitens, residual, deviance


@_compiled
def _widen(deviation, weights, measured, replicates, covariance, whiten):
    """Add the scatter of a cell's nodes to its covariance, and whiten by that; the ln of its determinant."""
    for i in range(4):
        for j in range(4):
            if measured[i] and measured[j]:
                covariance[i, j] += np.sum(weights * deviation[:, i] * deviation[:, j]) / replicates
    root = np.zeros((4, 4))
    log_det = 0.0
    for i in range(4):
        for j in range(i + 1):
            rest = covariance[i, j]
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(rest) if i == j else rest / root[j, j]
        log_det += 2 * math.log(root[i, i])
    for j in range(4):
        for i in range(4):
            rest = 1.0 if i == j else 0.0
            for k in range(j, i):
                rest -= root[i, k] * whiten[k, j]
            whiten[i, j] = rest / root[i, i] if i >= j else 0.0
    return log_det


@_compiled
def local_jacobian(values, margin, virgin_margin, steps, walking, virgin_walking, weights, measured, whiten):
    """d(whitened prediction)/d(θ, ln k) ``(rows, cells, 4, parameters + 1)``.

    ``values (parameters + 3, rows, cells, nodes, 4)`` and margins are those with each parameter, ln k and the depth
    moved by ``steps (parameters + 2, rows)``, and unmoved.
    """
    count, (rows, cells, nodes) = len(steps) - 1, walking.shape
    found = np.zeros((rows, cells, 4, count))
    slope = np.empty(4)
    for row in range(rows):
        for cell in range(cells):
            weight = weights[row % len(weights), cell % weights.shape[1]]
            for p in range(count):
                slope[:] = 0.0
                for node in range(nodes):
                    at = (row, cell, node)
                    sink = _sinking(margin, p, at, steps) if walking[at] else 0.0
                    first = _sinking(virgin_margin, p, at, steps) if virgin_walking[at] else 0.0
                    for i in range(4):
                        unmoved = values[-1, row, cell, node, i]
                        direct = (values[p, row, cell, node, i] - unmoved) / steps[p, row]
                        by_depth = (values[count, row, cell, node, i] - unmoved) / steps[count, row]
                        slope[i] += weight[node, i] * (direct + by_depth * (first if i == 3 else sink))
                for i in range(4):
                    for j in range(i + 1):
                        if measured[cell, j]:
                            found[row, cell, i, p] += whiten[row, cell, i, j] * slope[j]
    return found


@_compiled
def _sinking(margin, p, at, steps):
    """dd/dθ for a parameter or ln k; a depth at a jump of the margin does not move."""
    row, cell, node = at
    unmoved, count = margin[-1, row, cell, node], len(steps) - 1
    stiff = (margin[count, row, cell, node] - unmoved) / steps[count, row]
    return -(margin[p, row, cell, node] - unmoved) / steps[p, row] / stiff if stiff > 1e-6 else 0.0
