"""Pictures as binary messages: a 40-byte header, then rows of float16 (or uint16).

On a fast link the rows go out as they are. On a slow one each row is written as
differences of the numbers' bit patterns (neighbours in a picture share sign and exponent),
split into a plane of low and a plane of high bytes, and deflated at level 1.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from burnish.app.messages import FRAME_MAGIC
from burnish.core.types import Float32

HEADER = struct.Struct("<10I")
RAW, DEFLATED = 0, 1
_LARGEST_HALF = 65504.0


class Kind(IntEnum):
    """What a binary message shows; see `messages.FrameHeader`."""

    PICTURE = 0
    OBJECTS = 1
    COMPARISON = 2
    RESTING = 3


@dataclass(frozen=True)
class Frame:
    """One picture on its way to the pages.

    pixels: uint16 [height, width, channels]: float16 bit patterns of linear RGB, or object
    numbers. Encoded once, however many pages take it. corner: the view's pixel (x, y) that the
    first one lies on.
    """

    kind: Kind
    view: int
    number: int
    revision: int
    pixels: NDArray[np.uint16]
    corner: tuple[int, int] = (0, 0)

    @property
    def slot(self) -> tuple[Kind, int]:
        """A newer frame of the same slot replaces this one."""
        return self.kind, self.view

    def _header(self, codec: int) -> bytes:
        height, width, _ = self.pixels.shape
        return HEADER.pack(
            FRAME_MAGIC,
            self.kind,
            self.view,
            codec,
            width,
            height,
            self.number,
            self.revision,
            *self.corner,
        )

    @cached_property
    def raw(self) -> bytes:
        """The message with its rows as they are."""
        return self._header(RAW) + self.pixels.astype("<u2", copy=False).tobytes()

    @cached_property
    def deflated(self) -> bytes:
        """The message for a slow link."""
        return self._header(DEFLATED) + zlib.compress(_planes(self.pixels), 1)


def halves(image: Float32) -> NDArray[np.uint16]:
    """Linear RGB float32 [height, width, 3] as float16 bit patterns.

    Beyond float16's range the largest number stands; what is not a number becomes 0.
    """
    # Most pictures need no care, and what a NaN is compared with is false
    if not (image.min(initial=0.0) >= -_LARGEST_HALF and image.max(initial=0.0) <= _LARGEST_HALF):
        image = np.nan_to_num(image, nan=0.0, posinf=_LARGEST_HALF, neginf=0.0)
        image = np.clip(image, -_LARGEST_HALF, _LARGEST_HALF)
    return image.astype(np.float16).view(np.uint16)


def _planes(pixels: NDArray[np.uint16]) -> bytes:
    """Differences along each row, low bytes first, then high bytes."""
    rows = pixels.astype(np.uint16, copy=True)
    rows[:, 1:] -= pixels[:, :-1]
    low, high = (rows & 0xFF).astype(np.uint8), (rows >> 8).astype(np.uint8)
    return low.tobytes() + high.tobytes()


def read(message: bytes) -> Frame:
    """A frame back from its message; what the page does, for tests and other clients."""
    magic, kind, view, codec, width, height, number, revision, *corner = HEADER.unpack_from(message)
    if magic != FRAME_MAGIC:
        raise ValueError("not a frame")
    channels = 1 if kind == Kind.OBJECTS else 3
    body = message[HEADER.size :]
    if codec == DEFLATED:
        planes = np.frombuffer(zlib.decompress(body), np.uint8).reshape(2, height, width, channels)
        rows = planes[0].astype(np.uint16) | planes[1].astype(np.uint16) << 8
        pixels = np.cumsum(rows, axis=1, dtype=np.uint16)
    else:
        pixels = np.frombuffer(body, "<u2").reshape(height, width, channels).astype(np.uint16)
    return Frame(Kind(kind), view, number, revision, pixels, (corner[0], corner[1]))
