"""Pictures on disk: EXR for linear light, PNG for looking at.

A picture is written beside its place and moved there when it is whole, so that whoever
looks finds the old one or the new one. Needs no ray tracer.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from burnish.core.colour import linear_from_srgb
from burnish.core.errors import BurnishError, CannotWrite, InvalidValue, MissingFile
from burnish.core.types import AnyArray, Float32
from burnish.runtime.tonemap import ToneMap

SUFFIXES = (".exr", ".png")


def check_destination(path: str | os.PathLike[str]) -> Path:
    """Whether a picture could be written there, asked before work is put into it.

    Raises InvalidValue for a suffix other than .exr and .png, MissingFile for a folder that
    does not exist, CannotWrite for one that does not take files.
    """
    place = Path(path)
    if place.suffix.lower() not in SUFFIXES:
        raise InvalidValue(f"a picture's name must end in .exr or .png; got {str(path)!r}")
    if not place.parent.is_dir():
        raise MissingFile(
            f"output folder {str(place.parent)!r} does not exist; make it first: "
            f"mkdir -p {place.parent}"
        )
    if place.is_dir():
        raise CannotWrite(f"{str(path)!r} is a folder; name a file in it")
    if not os.access(place.parent, os.W_OK):
        raise CannotWrite(f"output folder {str(place.parent)!r} is not writable; choose another")
    return place


def write_picture(
    path: str | os.PathLike[str], image: AnyArray, tone: ToneMap | None = None
) -> None:
    """Write linear RGB [height, width, 3]: .exr as float32, .png as 8-bit sRGB.

    tone: how a .png shows light; an .exr keeps it as it is. Without one, the sRGB curve
    over [0, 1].

    Raises as `check_destination` does, and CannotWrite when the disk is full.
    """
    place = check_destination(path)
    pixels = np.ascontiguousarray(image, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3:
        raise InvalidValue(f"a picture must be [height, width, 3]; got {pixels.shape}")
    if place.suffix.lower() == ".exr":
        write_whole(place, lambda beside: _write_exr(beside, pixels))
    else:
        shown = (tone or ToneMap()).to_bytes(pixels)
        write_whole(place, lambda beside: _write_png(beside, shown))


def read_picture(path: str | os.PathLike[str]) -> Float32:
    """Linear RGB float32 [height, width, 3] of an EXR or PNG file; alpha is left out.

    Raises MissingFile, InvalidValue for what is no such picture.
    """
    place = Path(path)
    if not place.is_file():
        raise MissingFile(f"no picture at {str(path)!r}")
    try:
        return _read_exr(place) if place.suffix.lower() == ".exr" else _read_png(place)
    except (OSError, RuntimeError, KeyError) as error:
        raise InvalidValue(f"{str(path)!r} is not a readable picture: {error}") from error


def write_whole(place: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a file beside `place`, then move it there; on failure leave nothing.

    The file beside has the suffix of `place`. Raises CannotWrite.
    """
    try:
        handle, name = tempfile.mkstemp(place.suffix, f".{place.stem}-", place.parent)
        os.close(handle)
    except OSError as error:
        raise CannotWrite(f"cannot write {str(place)!r}: {error.strerror}") from error
    beside = Path(name)
    try:
        write(beside)
        with beside.open("rb") as written:
            os.fsync(written.fileno())
        beside.chmod(0o666 & ~_umask())
        beside.replace(place)
    except BurnishError:
        raise
    except (OSError, RuntimeError) as error:
        # OpenEXR tells of a full disk by a RuntimeError.
        reason = getattr(error, "strerror", None) or str(error)
        raise CannotWrite(
            f"cannot write {str(place)!r}: {reason}; free some space or choose another folder"
        ) from error
    finally:
        beside.unlink(missing_ok=True)


def _umask() -> int:
    """The process's file mode mask, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _write_exr(path: Path, pixels: Float32) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": pixels}) as file:
        file.write(str(path))


def _read_exr(path: Path) -> Float32:
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        # A picture with luminance alone stands for grey.
        names = "RGB" if "R" in channels else "YYY"
        return np.stack([np.asarray(channels[name].pixels, np.float32) for name in names], axis=-1)


def _write_png(path: Path, shown: AnyArray) -> None:
    from PIL import Image

    Image.fromarray(shown).save(path, format="PNG")


def _read_png(path: Path) -> Float32:
    from PIL import Image

    with Image.open(path) as picture:
        encoded = np.asarray(picture.convert("RGB"), np.float64) / 255.0
    return linear_from_srgb(encoded).astype(np.float32)
