"""Rows: which object a pixel meets first, and where."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from burnish.core.types import AnyArray, Float32, Int32

POINTS = 16
"""Points of a row at which pictures on its surface are looked up."""


@dataclass
class Rows:
    """One entry per (pixel, object, kind); a silhouette pixel has several.

    Arrays over r rows, sorted by object, then kind, then pixel:
      pixel: int32 [r], y · width + x.
      object: int32 [r], index into `Basis.objects`.
      indirect: bool [r]; False for an object met directly or through a mirror-like chain
        (all fine columns), True for one met after rougher fixed vertices (coarse columns).
      weight: float32 [r], the share of the pixel's filter that meets the object.
      position, normal: float32 [r, 3], world space; uv: float32 [r, 2]; means over the row.
      cos_theta_o: float32 [r], mean cosine of the outgoing angle, 0 to 1.
      spread: float16 [r, POINTS, 2], where in uv the row's points lie, relative to its mean;
        zeros where only the mean is known.
    """

    pixel: Int32
    object: Int32
    indirect: AnyArray
    weight: Float32
    position: Float32
    normal: Float32
    uv: Float32
    cos_theta_o: Float32
    spread: AnyArray = field(default_factory=lambda: np.zeros(0, np.float16))

    def __post_init__(self) -> None:
        if self.spread.ndim != 3:
            self.spread = np.zeros((len(self.pixel), POINTS, 2), np.float16)

    @property
    def uv_points(self) -> Float32:
        """uv of the rows' points: float32 [r, POINTS, 2]."""
        return np.asarray(self.uv[:, None] + self.spread.astype(np.float32))

    def __len__(self) -> int:
        return len(self.pixel)

    def select(self, which: AnyArray) -> Rows:
        """The rows at the given indices or mask."""
        return Rows(**{name: getattr(self, name)[which] for name in ROW_FIELDS})

    @staticmethod
    def concatenate(parts: list[Rows]) -> Rows:
        """Rows of several tiles, in their order."""
        if not parts:
            return Rows.empty()
        return Rows(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in ROW_FIELDS}
        )

    @staticmethod
    def empty() -> Rows:
        """No rows."""
        return Rows(
            pixel=np.zeros(0, np.int32),
            object=np.zeros(0, np.int32),
            indirect=np.zeros(0, np.bool_),
            weight=np.zeros(0, np.float32),
            position=np.zeros((0, 3), np.float32),
            normal=np.zeros((0, 3), np.float32),
            uv=np.zeros((0, 2), np.float32),
            cos_theta_o=np.zeros(0, np.float32),
        )


ROW_FIELDS = (
    "pixel",
    "object",
    "indirect",
    "weight",
    "position",
    "normal",
    "uv",
    "cos_theta_o",
    "spread",
)
