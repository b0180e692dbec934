"""MERL `.binary` files (Matusik et al. 2003): read, checked, and written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from burnish.core.errors import CannotWrite, MeasurementError, MissingFile
from burnish.materials.measured.register import keep
from burnish.materials.measured.table import ReflectanceTable

SHAPE = (90, 90, 180)
"""Cells of θh, θd and φd."""
SCALE = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)
"""From the file's units to 1/sr, per channel."""
HEADER = 12


def read_merl(path: str | Path) -> ReflectanceTable:
    """A measured material: three int32 (90, 90, 180), then float64 [3, 90, 90, 180].

    Negative, NaN and infinite cells, which real files have below the horizon and in grazing
    corners, are invalid: `invalid_count` of the result says how many.
    Raises MissingFile; MeasurementError when the file is truncated, too long or of other
    dimensions, or when no cell is valid.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFile(f"{path}: no such file; give a MERL .binary file")
    size = path.stat().st_size
    with path.open("rb") as file:
        head = np.frombuffer(file.read(HEADER), "<i4")
        if len(head) < 3:
            raise MeasurementError(f"{path}: {size} bytes are too few for a MERL file's header")
        if tuple(head) != SHAPE:
            raise MeasurementError(
                f"{path}: its dimensions are {' x '.join(map(str, head))}, not 90 x 90 x 180; "
                "it is no isotropic MERL .binary file"
            )
        expected = HEADER + 8 * 3 * int(np.prod(SHAPE))
        if size != expected:
            what = "truncated" if size < expected else "longer than it should be"
            raise MeasurementError(
                f"{path}: the file is {what}: {size} bytes in place of {expected}; fetch it again"
            )
        raw = np.fromfile(file, "<f8").reshape(3, *SHAPE)
    try:
        table = ReflectanceTable(raw, SCALE)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    keep(table, path)
    return table


def write_merl(path: str | Path, table: ReflectanceTable) -> None:
    """Write a table as a MERL file; what `read_merl` gave comes back to the byte.

    Raises MeasurementError for a table of other dimensions, CannotWrite.
    """
    if table.raw.shape != (3, *SHAPE):
        raise MeasurementError(
            f"{path}: a MERL file holds 90 x 90 x 180 cells; this table has "
            f"{' x '.join(map(str, table.raw.shape[1:]))}"
        )
    factor = np.asarray(table.scale) / np.asarray(SCALE)
    raw = table.raw if (factor == 1).all() else table.raw * factor[:, None, None, None]
    try:
        with Path(path).open("wb") as file:
            file.write(np.array(SHAPE, "<i4").tobytes())
            file.write(np.ascontiguousarray(raw, "<f8").tobytes())
    except OSError as error:
        raise CannotWrite(f"{path}: cannot be written ({error.strerror or error})") from error
    keep(table, Path(path))
