"""Tables by the hash of their numbers, so that a model names its data and does not hold it.

A bundle stores the hash and the path of the file, not the data: they are large, and measured
data may often not be passed on.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from burnish.core.errors import MeasurementError, MissingFile
from burnish.materials.measured.table import ReflectanceTable

_tables: dict[str, ReflectanceTable] = {}
_paths: dict[str, str] = {}


def keep(table: ReflectanceTable, path: Path | None = None) -> str:
    """Register a table, with the file that it can be read from again; gives its key."""
    _tables.setdefault(table.key, table)
    if path is not None:
        _paths[table.key] = str(path.resolve())
    return table.key


def path_of(key: str) -> str:
    """The file of a table, or ""."""
    return _paths.get(key, "")


def find(key: str, path: str = "") -> ReflectanceTable:
    """The table of a key, read from its file where need be; "" is a matte grey.

    Raises MissingFile when the file is not there, MeasurementError when it holds other data.
    """
    if not key:
        return matte()
    if key not in _tables:
        if not path:
            raise MissingFile(
                f"measured reflectance {key[:12]}… was never saved; write it with `write_merl` "
                "before a bundle or another process needs it"
            )
        from burnish.materials.measured.merl import read_merl

        found = read_merl(path)
        if found.key != key:
            raise MeasurementError(
                f"{path}: holds other data than when the material was made; restore the file"
            )
    return _tables[key]


@lru_cache(maxsize=1)
def matte() -> ReflectanceTable:
    """Half of the light, evenly in all directions."""
    return ReflectanceTable(np.full((3, 4, 4, 4), 0.5 / np.pi))
