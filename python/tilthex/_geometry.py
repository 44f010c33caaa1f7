"""Boxes, hulls and their volumes, for `tilthex.polytope`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def section_vertices(rows: Array, target: Array, lower: Array, upper: Array) -> Iterator[Array]:
    """Vertices of the box where `rows @ u = target`: all inputs except a few are at their limits."""
    moving = np.flatnonzero(upper > lower)
    base = np.where(upper > lower, 0.0, lower)
    left = target - rows @ base
    # Rows that are repeated, or that no rotor changes, determine no input.
    scale = np.linalg.norm(rows, axis=1)
    independent: list[int] = []
    for r in range(len(rows)):
        chosen = [*independent, r]
        if scale[r] and np.linalg.matrix_rank(rows[chosen][:, moving] / scale[chosen, None], 1e-9) == len(
            chosen
        ):
            independent.append(r)
    rows_of, left_of = rows[independent], left[independent]
    tolerance = 1e-9 * float(np.abs(np.concatenate([lower, upper])).max())
    consistency = 1e-7 * max(1e-12, float(np.abs(rows).max(initial=0.0)) * float(np.abs(upper).max()))
    for solved in itertools.combinations(moving, len(independent)):
        others = [i for i in moving if i not in solved]
        square = rows_of[:, list(solved)]
        if independent and abs(np.linalg.det(square / scale[independent][:, None])) < 1e-12:
            continue
        corners = np.array(list(itertools.product(*[(lower[i], upper[i]) for i in others])))
        corners = corners.reshape(-1 if others else 1, len(others))
        inputs = np.tile(base, (len(corners), 1))
        inputs[:, others] = corners
        if independent:
            inputs[:, list(solved)] = np.linalg.solve(
                square, left_of[:, None] - rows_of[:, others] @ corners.T
            ).T
        inside = ((inputs >= lower - tolerance) & (inputs <= upper + tolerance)).all(axis=1)
        inside &= (np.abs(inputs @ rows.T - target) <= consistency).all(axis=1)
        if inside.any():
            yield np.clip(inputs[inside], lower, upper)


def ridges(hull: Any) -> NDArray[np.intp]:
    """Pairs of vertices between facets of a hull that are not in the same plane, (m, 2)."""
    pairs = [
        (a, b)
        for i, (corners, neighbours) in enumerate(zip(hull.simplices, hull.neighbors, strict=True))
        for k, j in enumerate(neighbours)
        if i < j and hull.equations[i, :3] @ hull.equations[j, :3] < 1 - 1e-6
        for a, b in [np.delete(corners, k)]
    ]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def volume(points: Array, dimension: int, k: int) -> float:
    """Volume of the hull of points in k components, in the dimension that they span."""
    from scipy.spatial import ConvexHull, QhullError

    if dimension == 0:
        return 0.0
    if dimension < k:
        _, _, axes = np.linalg.svd(points - points.mean(axis=0))
        points = points @ axes[:dimension].T
    if dimension == 1:
        return float(np.ptp(points))
    size = np.ptp(points, axis=0)
    try:
        found = ConvexHull(points / size).volume
    except QhullError:
        found = ConvexHull(points / size, qhull_options="QJ").volume
    return float(found * np.prod(size))
