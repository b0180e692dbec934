"""Rows learn from their neighbours as far as two independent halves say that it helps.

The light on neighbouring rows of a surface differs little, the noise of their samples is their
own. A smoother is a local linear fit over the pixels, as wide as its σ, among rows whose
normals agree and that lie in one plane. What a row's fit from one half of the samples misses
of the other half is the smoother's error and a constant, so that each row finds its width.
"""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float64

WIDTHS = (1.0, 2.0, 4.0)
"""σ in pixels."""
SHARPNESS = 32
"""Power of the normals' cosine."""
SLOPE = 0.2
"""Tangent over which a neighbour counts as another surface."""


class Smoother:
    """Of R rows at pixels [R, 2], with normals and positions [R, 3], and the share [R] of the
    pixel that each is seen in, by which it counts."""

    def __init__(
        self, pixel: Float64, normal: Float64, position: Float64, coverage: Float64
    ) -> None:
        offset = pixel[None] - pixel[:, None]
        distance = (offset**2).sum(axis=2)
        way = position[None] - position[:, None]
        length = np.sqrt((way**2).sum(axis=2)) + 1e-12
        slope = np.abs(np.einsum("ijk,ik->ij", way, normal)) / length
        alike = np.maximum(normal @ normal.T, 0.0) ** SHARPNESS * np.exp(-((slope / SLOPE) ** 2))
        np.fill_diagonal(alike, 1.0)
        alike *= np.clip(coverage, 1e-3, 1.0)
        self._near = alike * np.exp(-distance / (2 * max(WIDTHS) ** 2))
        self.fits = [np.eye(len(pixel))]
        self.fits += [_linear(alike * np.exp(-distance / (2 * s * s)), offset, s) for s in WIDTHS]

    def choose(self, a: Float64, b: Float64) -> Float64:
        """The smoother for rows of which two halves [R, m] are known: [R, R]."""
        scores = []
        for fit in self.fits:
            missed = ((fit @ a - b) ** 2).sum(axis=1) + ((fit @ b - a) ** 2).sum(axis=1)
            # One row's miss is too noisy to judge by
            scores.append(self._near @ missed)
        best = np.argmin(scores, axis=0)
        return np.asarray(np.stack(self.fits)[best, np.arange(len(best))])


def _linear(weight: Float64, offset: Float64, sigma: float) -> Float64:
    """Rows of weights that evaluate a local linear fit at its centre: [R, R]."""
    terms = np.stack([np.ones_like(weight), offset[..., 0] / sigma, offset[..., 1] / sigma], axis=2)
    weighted = terms * weight[..., None]
    normal = np.einsum("ijk,ijl->ikl", weighted, terms)
    # Where neighbours do not span a plane the fit flattens
    normal[:, [1, 2], [1, 2]] += 1e-3 * normal[:, :1, 0]
    centre = np.zeros((len(weight), 3, 1))
    centre[:, 0] = 1.0
    return np.asarray(np.einsum("ijk,ik->ij", weighted, np.linalg.solve(normal, centre)[..., 0]))
