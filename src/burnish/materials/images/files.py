"""Pictures from files: PNG, JPEG and other eight or sixteen bits, and EXR."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import numpy as np

from burnish.core.colour import linear_from_srgb
from burnish.core.errors import InvalidValue, MissingFile
from burnish.core.types import AnyArray, Float32
from burnish.materials.images.texels import Texels

Channel = Literal["", "red", "green", "blue", "alpha"]
"""Which channel of the file a scalar takes; "" for its luminance."""
CHANNELS: tuple[str, ...] = ("", "red", "green", "blue", "alpha")
MOST_PIXELS = 1 << 26
"""Of a picture that is read at all: 8k × 8k."""
_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP", "TGA")
"""What Pillow may take a file for: some of its other readers start programs."""


def read_texels(path: str | os.PathLike[str], colour: bool, channel: Channel = "") -> Texels:
    """The texels of a file, its top row at v = 0, as Mitsuba and glTF have it.

    colour: the file's colours, sRGB where it has eight or sixteen bits; else one number, as it
    stands in the file. Raises MissingFile, InvalidValue.
    """
    place = Path(path)
    if channel not in CHANNELS:
        raise InvalidValue(
            f"a map's channel must be red, green, blue, alpha or none; got {channel!r}"
        )
    if not place.is_file():
        raise MissingFile(f"{place}: no such picture; check the path")
    pixels, coded = _read_exr(place) if place.suffix.lower() == ".exr" else _read_plain(place)
    if colour:
        if channel:
            raise InvalidValue("a colour takes all channels of a picture; leave the channel out")
        wide = np.broadcast_to(pixels[..., :1], (*pixels.shape[:2], 3))
        values = pixels[..., :3] if pixels.shape[2] >= 3 else wide
        linear = linear_from_srgb(values) if coded else values
        return Texels(np.asarray(linear, np.float32))
    if channel:
        number = CHANNELS.index(channel) - 1
        if number >= pixels.shape[2]:
            raise InvalidValue(f"{place}: the picture has no channel {channel}")
        return Texels(pixels[..., number : number + 1])
    return Texels(pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1]).single()


def _read_plain(path: Path) -> tuple[Float32, bool]:
    """float32 [height, width, channels] in [0, 1], and that its colours are sRGB."""
    from PIL import Image, UnidentifiedImageError

    before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(path, formats=_FORMATS) as picture:
            _check_size(path, *picture.size)
            if picture.mode.startswith(("I", "F")):
                deep = np.asarray(picture, np.float32)[..., None]
                most = np.float32(65535 if picture.mode.startswith("I") else 1)
                return np.asarray(deep / most, np.float32), True
            bands = "A" in picture.getbands() or "transparency" in picture.info
            mode = "L" if picture.mode in ("1", "L") else "RGBA" if bands else "RGB"
            pixels: AnyArray = np.asarray(picture.convert(mode), np.float32) / 255
    except (UnidentifiedImageError, OSError, SyntaxError):
        raise InvalidValue(
            f"{path}: not a picture that can be read; give a PNG, JPEG or EXR file"
        ) from None
    finally:
        Image.MAX_IMAGE_PIXELS = before
    return (pixels if pixels.ndim == 3 else pixels[..., None]), True


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MOST_PIXELS:
        raise InvalidValue(
            f"{path}: has {width} × {height} pixels, more than can be read "
            f"({MOST_PIXELS:,}); scale it down"
        )


def _read_exr(path: Path) -> tuple[Float32, bool]:
    """float32 [height, width, channels], linear."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = (np.asarray(corner, np.int64) for corner in file.header()["dataWindow"])
    except Exception as error:  # noqa: BLE001 - the library raises what it likes
        raise InvalidValue(f"{path}: not an EXR file that can be read ({error})") from None
    width, height = (high - low + 1).tolist()
    _check_size(path, width, height)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            found = {name: np.asarray(item.pixels) for name, item in file.channels().items()}
    except Exception as error:  # noqa: BLE001 - the library raises what it likes
        raise InvalidValue(f"{path}: not an EXR file that can be read ({error})") from None
    names = [name for name in ("R", "G", "B", "A") if name in found] or sorted(found)[:1]
    pixels = np.stack([found[name] for name in names], axis=-1).astype(np.float32)
    return np.nan_to_num(pixels, posinf=0.0, neginf=0.0), False
