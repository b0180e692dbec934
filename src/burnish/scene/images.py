"""Mitsuba's textures as pictures that can be edited, and back."""

from __future__ import annotations

import atexit
import hashlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.colour import linear_from_srgb
from burnish.core.types import Float32
from burnish.materials.images.image import UPRIGHT, ImageMap, Transform
from burnish.materials.images.texels import Texels

_GRID = 1024
"""Texels along each side of a picture of a texture that is none by itself."""
_PROBES = 256
_CLOSE = 2e-3


def image_of(texture: Mapping[str, Any], colour: bool) -> ImageMap:
    """The picture that a texture shows over the unit square of uv, repeated beyond it.

    texture: a Mitsuba dictionary. colour: as colours; else as one number. A bitmap keeps its own
    texels; whatever else there is becomes a picture of 1024² of them.
    """
    plugin = mi.load_dict(dict(texture))
    uv = np.random.default_rng(1).random((_PROBES, 2)).astype(np.float32)
    for found in _bitmaps(texture, plugin, colour):
        if np.abs(found.raw(uv) - _evaluated(plugin, uv, colour)).max() < _CLOSE:
            return found
    side = ((np.arange(_GRID) + 0.5) / _GRID).astype(np.float32)
    uv = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return ImageMap(Texels(_evaluated(plugin, uv, colour).reshape(_GRID, _GRID, -1)))


def described(image: ImageMap) -> dict[str, Any]:
    """A Mitsuba dictionary of what a picture gives, limits 0 and 1, over an EXR file of its own.

    The file lasts as long as the process.
    """
    values = np.clip(image.texels.values * image.scale + image.offset, 0, 1).astype(np.float32)
    # Pictures of one colour have the same bytes however wide they are
    digest = hashlib.sha256(str(values.shape).encode())
    digest.update(values.tobytes())
    path = _folder() / f"{digest.hexdigest()[:32]}.exr"
    if not path.is_file():
        flat = values if values.shape[2] == 3 else values[..., 0]
        mi.Bitmap(np.ascontiguousarray(flat)).write(str(path))
    result: dict[str, Any] = {
        "type": "bitmap",
        "filename": str(path),
        "raw": True,
        "wrap_mode": image.wrap,
        "filter_type": "bilinear" if image.smooth else "nearest",
    }
    if image.transform != UPRIGHT:
        a, b, c, d, e, f = image.transform
        result["to_uv"] = mi.ScalarTransform3f(np.array([[a, b, c], [d, e, f], [0, 0, 1.0]]))
    return result


def _bitmaps(texture: Mapping[str, Any], plugin: Any, colour: bool) -> Iterator[ImageMap]:
    """What a bitmap's own texels may mean: linear or, of eight bits, sRGB; nothing for another
    texture."""
    if texture["type"] != "bitmap":
        return
    parameters = mi.traverse(plugin)
    stored = np.asarray(parameters["data"])
    if stored.ndim != 3 or stored.shape[2] not in (1, 3):
        return
    values = stored.astype(np.float32)
    meanings = [values]
    if stored.dtype == np.uint8:
        values = np.asarray(values / 255, np.float32)
        meanings = [values, np.asarray(linear_from_srgb(values), np.float32)]
    for meant in meanings:
        texels = Texels(meant)
        yield ImageMap(
            texels.coloured() if colour else texels.single(),
            transform=_transform(parameters["to_uv"].matrix),
            wrap=texture.get("wrap_mode", "repeat"),
            smooth=texture.get("filter_type", "bilinear") == "bilinear",
        )


def _transform(matrix: Any) -> Transform:
    (a, b, c), (d, e, f) = np.asarray(matrix, np.float64).reshape(3, 3)[:2].tolist()
    return a, b, c, d, e, f


def _evaluated(plugin: Any, uv: Float32, colour: bool) -> Float32:
    """A texture at uv [n, 2]: float32 [n, 3 or 1]."""
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(uv[:, 0], uv[:, 1])
    channels = 3 if colour else 1
    found = mi.Color3f(plugin.eval(si)) if colour else plugin.eval_1(si)
    values = np.asarray(found, np.float32).reshape(channels, -1)
    return np.broadcast_to(values, (channels, len(uv))).T.astype(np.float32)


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="burnish-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
