"""Principal components of a set of vectors that are few and long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float64


@dataclass(frozen=True, eq=False)
class Leading:
    """The leading components of rows float64 [m, n], as combinations of the rows.

    mixing: float64 [m, k]; rows.T @ mixing are k orthonormal vectors. errors, worst: float64
    [at most `most`], the RMS and the largest length of what is left of the rows after 0, 1, 2, …
    components.
    """

    mixing: Float64
    errors: Float64
    worst: Float64


def same_signs(vectors: Float64) -> Float64:
    """Vectors, the columns of float64 [m, k], turned so that the first of the largest entries of
    each is positive: either sign is as good, and libraries differ in it."""
    size = np.abs(vectors)
    # Entries that are alike but for rounding count as alike
    first = (size >= (1 - 1e-3) * size.max(axis=0, initial=0.0)).argmax(axis=0)
    return np.asarray(vectors * np.sign(vectors[first, np.arange(vectors.shape[1])]))


def leading(rows: Float64, error: float, most: int) -> Leading:
    """As many components as leave an RMS of at most `error` over the rows, but at most `most`."""
    # The components follow from the rows' inner products
    values, vectors = np.linalg.eigh(rows @ rows.T)
    order = np.argsort(values)[::-1][:most]
    order = order[values[order] > 1e-13 * max(float(values.max()), 1e-300)]
    mixing = same_signs(vectors[:, order]) / np.sqrt(values[order])
    left = np.sum(rows**2, axis=1)
    shares = (rows @ (rows.T @ mixing)) ** 2
    squares = np.maximum(np.stack([left, *(left - np.cumsum(shares, axis=1).T)]), 0.0)
    errors, worst = np.sqrt(squares.mean(axis=1)), np.sqrt(squares.max(axis=1))
    enough = np.nonzero(errors <= error)[0]
    count = int(enough[0]) if len(enough) else len(errors) - 1
    return Leading(mixing[:, :count], errors, worst)
