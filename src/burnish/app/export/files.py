"""The files beside an exported scene: copies, and textures that only burnish's plugins had.

Every file that a scene names goes into one folder beside it, `NAME_files`, under its own
name (made unique), and is named relative to the scene: the two move together.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import RGB, AnyArray, Float32
from burnish.scene.reader import Description, rgb
from burnish.scene.tree import UniqueNames

LARGEST = 4096
"""The longest side of a texture that is evaluated anew."""
SMALLEST = 256


class Folder:
    """The folder beside an export; made when the first file goes into it."""

    def __init__(self, scene: Path) -> None:
        self.path = scene.with_name(f"{scene.stem}_files")
        self.written: list[Path] = []
        self._names = UniqueNames()
        self._copies: dict[str, str] = {}

    def place(self, name: str) -> Path:
        """Where a new file of about that name goes."""
        self.path.mkdir(exist_ok=True)
        stem, suffix = Path(name).stem, Path(name).suffix
        place = self.path / (self._names(stem) + suffix)
        self.written.append(place)
        return place

    def relative(self, place: Path) -> str:
        """How the scene beside the folder names a file in it."""
        return f"{self.path.name}/{place.name}"

    def copy(self, source: str) -> str:
        """A file's copy, as the scene names it; each file is copied once."""
        if source not in self._copies:
            place = self.place(Path(source).name)
            shutil.copyfile(source, place)
            self._copies[source] = self.relative(place)
        return self._copies[source]

    def picture(self, name: str, linear: AnyArray) -> Path:
        """A linear EXR of [height, width, 3]."""
        place = self.place(f"{name}.exr")
        pixels = np.ascontiguousarray(linear, np.float32)
        mi.Bitmap(pixels).convert(component_format=mi.Struct.Type.Float16).write(str(place))
        return place


class Textures:
    """Colours under weight maps as stock textures, with what must be evaluated anew on disk."""

    def __init__(self, folder: Folder, name: str, maps: Mapping[str, Description]) -> None:
        """maps: the texture of each group of layers that has a weight map."""
        self.folder, self.name, self.maps = folder, name, maps

    def __call__(self, colours: Sequence[tuple[str, RGB]]) -> Any:
        """The description of Σ H · colour over groups."""
        used = [(group, colour) for group, colour in colours if any(colour)]
        if not any(group in self.maps for group, _ in used):
            return rgb(np.sum([colour for _, colour in used], axis=0) if used else (0.0,) * 3)
        if len(used) == 1:
            return self.tinted(self.maps[used[0][0]], used[0][1])
        parts = [(self.maps.get(group), colour) for group, colour in used]
        return self._baked(parts)

    def stock(self, value: Any) -> Any:
        """A description with every texture plugin of burnish's own replaced."""
        if not isinstance(value, Mapping):
            return value
        if str(value.get("type", "")).startswith("burnish_"):
            found = self._product(value)
            return self._baked([(value, (1.0, 1.0, 1.0))]) if found is None else found
        return {key: self.stock(part) for key, part in value.items()}

    def tinted(self, texture: Description, tint: RGB) -> Any:
        """A texture times a colour: the same plugin with other texels or colours."""
        texture = self.stock(texture)
        if tint == (1.0, 1.0, 1.0):
            return texture
        if texture["type"] == "bitmap" and "filename" in texture:
            linear = linear_texels(texture) * np.asarray(tint, np.float32)
            place = self.folder.picture(f"{self.name}-{Path(texture['filename']).stem}", linear)
            return {**texture, "filename": str(place)}
        if texture["type"] == "checkerboard":
            parts = {name: texture.get(name, default) for name, default in _CHECKS.items()}
            tints = {name: self._tinted_value(value, tint) for name, value in parts.items()}
            if None not in tints.values():
                return {**texture, **tints}
        return self._baked([(texture, tint)])

    def baked(self, texture: Description) -> dict[str, Any]:
        """A texture evaluated over the unit square of uv, as a bitmap that repeats."""
        return self._baked([(texture, (1.0, 1.0, 1.0))])

    def _tinted_value(self, value: Any, tint: RGB) -> Any:
        """A constant colour times a tint, or None where it is none."""
        if isinstance(value, (int, float)):
            return rgb([value * c for c in tint])
        if value["type"] in ("rgb", "uniform"):
            return rgb(np.asarray(value["value"]) * tint)
        return None

    def _product(self, value: Mapping[str, Any]) -> Any:
        """A product of one texture and constant colours, tinted; None where it is another."""
        tint, textures, number = np.ones(3), [], 0
        while f"nested_{number}" in value:
            nested = value[f"nested_{number}"]
            if value[f"offset_{number}"] or value[f"single_{number}"]:
                return None
            if nested["type"] == "rgb":
                tint = tint * value[f"scale_{number}"] * np.asarray(nested["value"])
            else:
                tint = tint * value[f"scale_{number}"]
                textures.append(nested)
            number += 1
        if len(textures) != 1:
            return None
        red, green, blue = tint.tolist()
        return self.tinted(textures[0], (red, green, blue))

    def _baked(self, parts: Sequence[tuple[Description | None, RGB]]) -> dict[str, Any]:
        """Σ texture · colour over the unit square of uv, as a bitmap that repeats."""
        side = max([SMALLEST, *(_side(texture) for texture, _ in parts if texture is not None)])
        total = np.zeros((side, side, 3), np.float32)
        for texture, colour in parts:
            shown = np.float32(1) if texture is None else evaluated(texture, side)
            total += shown * np.asarray(colour, np.float32)
        return {"type": "bitmap", "filename": str(self.folder.picture(self.name, total))}


_CHECKS = {"color0": 0.4, "color1": 0.2}


def linear_texels(texture: Description) -> Float32:
    """The texels of a bitmap as Mitsuba interpolates them: float32 [height, width, 3]."""
    bitmap = mi.Bitmap(str(texture["filename"]))
    if texture.get("raw", False):
        bitmap.set_srgb_gamma(False)
    found = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    return np.array(found)


def evaluated(texture: Description, side: int) -> Float32:
    """A texture at the centres of side² texels; like a bitmap's, the first row has least v."""
    x = (np.arange(side, dtype=np.float32) + 0.5) / side
    u, v = (a.ravel() for a in np.meshgrid(x, x))
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(mi.Float(u), mi.Float(v))
    shown = np.array(mi.Color3f(mi.load_dict(dict(texture)).eval(si)), np.float32).reshape(3, -1)
    return np.broadcast_to(shown, (3, side * side)).T.reshape(side, side, 3)


def _side(texture: Any) -> int:
    """The longest side of the bitmaps in a description, for their tiling too."""
    if not isinstance(texture, Mapping):
        return 0
    own = 0
    if texture.get("type") == "bitmap" and "filename" in texture:
        tiling = 1.0
        if "to_uv" in texture:
            tiling = float(np.abs(np.array(texture["to_uv"].matrix)[:2, :2]).sum(axis=1).max())
        own = round(max(mi.Bitmap(str(texture["filename"])).size()) * max(tiling, 1.0))
    return min(max([own, *(_side(part) for part in texture.values())]), LARGEST)
