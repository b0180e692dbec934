"""RGL `.bsdf` files (Dupuy and Jakob 2018), as far as Mitsuba's `measured` evaluates them."""

from __future__ import annotations

import struct
from math import prod
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import MeasurementError, MissingFile
from burnish.core.types import Float64
from burnish.materials.maths import Vector
from burnish.materials.measured.merl import SCALE, SHAPE
from burnish.materials.measured.register import keep
from burnish.materials.measured.table import ReflectanceTable

SMALLEST_COSINE = 0.02
"""Directions lower than this are not asked for: the data end before, and 1 / cos magnifies."""

TURNS = (0.0, np.pi / 3, 0.7 * np.pi)
"""Azimuths of the whole pair that an isotropic material must look the same from."""

ANISOTROPY = 0.03
"""Relative RMS of what changes between them, from where a material counts as anisotropic."""

_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 8, 8: 8, 9: 2, 10: 4, 11: 8}
"""Bytes of a number by the format's code of its type."""


def read_rgl(path: str | Path, shape: tuple[int, int, int] = SHAPE) -> ReflectanceTable:
    """The isotropic table of a file, sampled at the centres of its cells.

    Mitsuba gives ρ cosθ; both ways round are averaged, since a table is reciprocal. Cells with
    a direction near the horizon or below it, and those that Mitsuba finds no number for, are
    invalid and take a neighbour's value. shape: cells of θh, θd and φd; those of a MERL file
    without it, so that `write_merl` keeps the result for bundles and other processes.

    Needs Mitsuba and an RGB variant; of RGL's files it reads those that end in `_rgb.bsdf`.
    Raises MissingFile; MeasurementError for files that are truncated, spectral or of another
    form, for anisotropic materials, and where no cell is valid.
    """
    path = Path(path)
    _check(path)
    try:
        bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
    except RuntimeError as error:
        raise MeasurementError(
            f"{path}: Mitsuba cannot read it ({str(error).strip().splitlines()[-1]}); give the "
            "material's _rgb.bsdf file"
        ) from None
    empty = ReflectanceTable(np.ones((3, *shape)))
    wi, wo = (Vector(*(np.broadcast_to(a, shape).ravel() for a in w)) for w in empty.directions())
    lit = np.nonzero((wi.z > SMALLEST_COSINE) & (wo.z > SMALLEST_COSINE))[0]
    wi, wo = (Vector(*(a[lit] for a in w)) for w in (wi, wo))
    _check_isotropy(path, bsdf, wi, wo)
    rho = (_reflectance(bsdf, wi, wo, 0.0) + _reflectance(bsdf, wo, wi, 0.0)) / 2
    raw = np.full((3, int(np.prod(shape))), np.nan)
    raw[:, lit] = rho
    scale = np.reshape(SCALE, (3, 1, 1, 1))
    try:
        table = ReflectanceTable(raw.reshape(3, *shape) / scale, SCALE)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    keep(table)
    return table


def _reflectance(bsdf: Any, wi: Vector, wo: Vector, turn: float) -> Float64:
    """ρ of pairs of directions, turned about the normal: float64 [3, n]."""
    c, s = np.cos(turn), np.sin(turn)
    light, view = (
        mi.Vector3f(
            *(mi.Float(a.astype(np.float32)) for a in (c * w.x - s * w.y, s * w.x + c * w.y, w.z))
        )
        for w in (wi, wo)
    )
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi.z))
    si.wi = view
    return np.asarray(bsdf.eval(mi.BSDFContext(), si, light), np.float64) / wi.z


def _check_isotropy(path: Path, bsdf: Any, wi: Vector, wo: Vector) -> None:
    some = slice(None, None, 97)
    light, view = (Vector(*(a[some] for a in w)) for w in (wi, wo))
    first, *others = (_reflectance(bsdf, light, view, turn) for turn in TURNS)
    known = np.isfinite(first)
    size = float(np.sqrt(np.mean(first[known] ** 2))) if known.any() else 0.0
    for other in others:
        both = known & np.isfinite(other)
        change = float(np.sqrt(np.mean((other - first)[both] ** 2))) if both.any() else 0.0
        if change > ANISOTROPY * size:
            raise MeasurementError(
                f"{path}: the material is anisotropic: it changes by {change / size:.0%} when it "
                "is turned, and a table of half and difference angles knows no azimuth"
            )


def _check(path: Path) -> None:
    """Read the header: Mitsuba maps the file, and would die of one that ends too early."""
    if not path.is_file():
        raise MissingFile(f"{path}: no such file; give an RGL .bsdf file")
    size = path.stat().st_size
    with path.open("rb") as file:
        try:
            if file.read(12) != b"tensor_file\0":
                raise MeasurementError(f"{path}: it is no RGL .bsdf file: its header is another")
            fields = struct.unpack("<BBI", file.read(6))[2]
            names = set()
            for _ in range(fields):
                (length,) = struct.unpack("<H", file.read(2))
                names.add(file.read(length).decode("utf-8", "replace"))
                count, kind, start = struct.unpack("<HBQ", file.read(11))
                dimensions = struct.unpack(f"<{count}Q", file.read(8 * count))
                end = start + prod(dimensions) * _SIZES.get(kind, 1)
                if end > size:
                    raise MeasurementError(
                        f"{path}: the file is truncated: {size} bytes in place of {end} or more; "
                        "fetch it again"
                    )
        except struct.error:
            raise MeasurementError(
                f"{path}: the file is truncated: {size} bytes are less than its header; fetch it "
                "again"
            ) from None
    if "rgb" not in names:
        raise MeasurementError(
            f"{path}: its numbers are spectral; give the material's _rgb.bsdf file"
            if "spectra" in names
            else f"{path}: it has no field 'rgb'; give an RGL _rgb.bsdf file"
        )
