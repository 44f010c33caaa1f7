"""Standard deviations of a search's result, for residuals of any colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 1.0
"""Innovations that are further apart than this count as independent, s."""
PIECES = 3, 4
"""Numbers of pieces between which the results may differ."""


def spread(residuals: Array, jacobian: Array, time: Array, prior: Array, cost: float) -> tuple[Array, Array]:
    """Standard deviations of the parameters: those that noise explains, and those that pieces show.

    The first are the larger ones of two: for white residuals, and for residuals that are independent after
    `BLOCK`. The second are at least the first. They are those of a mean over `PIECES` of the recording with
    equal information, times the ratio of the quantiles of Student's and the normal distribution, because the
    pieces are few. An error of the model that changes during the recording shows in them only.

    Args:
        residuals: At the result, (N,).
        jacobian: That of scipy for the loss soft_l1, (N, k): each row is scaled by its part of the Hessian.
        time: Times of the poses, s; each has the same number of residuals.
        prior: Information before the recording, (k,).
        cost: The least cost.
    """
    from scipy import stats

    count, size = jacobian.shape
    inverse = np.linalg.pinv(jacobian.T @ jacobian + np.diag(prior))
    z = residuals**2
    # d = J^T r w with w = rho'; the scale of a row is the root of rho' + 2 z rho''.
    plain = jacobian * ((1 + z) ** 0.75)[:, None]
    score = plain * (residuals * (1 + z) ** -0.5)[:, None]

    def scattered(block: NDArray[np.int64], factor: float = 1.0) -> Array:
        number = np.unique(np.repeat(block, count // len(time)), return_inverse=True)[1]
        sums = np.zeros((number.max() + 1, size))
        np.add.at(sums, number, factor * score)
        scatter = (sums.T @ sums) * len(sums) / max(len(sums) - 1, 1)
        found: Array = np.sqrt(np.diag(inverse @ (scatter + np.diag(prior)) @ inverse))
        return found

    white = np.sqrt(np.diag(inverse) * 2 * cost / max(count - size, 1))
    noise = np.maximum(white, scattered(np.floor((time - time[0]) / BLOCK).astype(np.int64)))
    told = np.sum((jacobian @ inverse) * jacobian, axis=1).reshape(len(time), -1).sum(axis=1).cumsum()
    whole = noise
    for pieces in PIECES:
        piece = np.minimum(pieces * told / told[-1], pieces - 1).astype(np.int64)
        few = float(stats.t.ppf(0.975, pieces - 1) / stats.norm.ppf(0.975))
        whole = np.maximum(whole, scattered(piece, few))
    return noise, whole
