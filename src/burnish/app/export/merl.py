"""Materials as MERL tables: one `.binary` for each object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from burnish.app.export.closest import is_smooth
from burnish.app.export.report import Exported
from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.coefficients import conserved
from burnish.materials.layer import Material, MaterialState
from burnish.materials.maths import Vector
from burnish.materials.measured import ReflectanceTable, edited_table, write_merl
from burnish.materials.measured.merl import SCALE, SHAPE
from burnish.materials.measured.models import Measured
from burnish.materials.reflectance import reflectance
from burnish.scene import SceneObject

BELOW = -1.0
"""What MERL's own files hold where a direction lies below the horizon."""


def write_tables(objects: Sequence[tuple[SceneObject, MaterialState]], path: Path) -> Exported:
    """Write the material of each object: to `path` for one, else to NAME-OBJECT.binary."""
    result = Exported()
    for item, state in objects:
        assert item.material is not None
        place = path if len(objects) == 1 else path.with_name(f"{path.stem}-{item.id}{path.suffix}")
        material = item.material.as_in(state)
        table, remarks = table_of(material, state)
        write_merl(place, table)
        result.files.append(place)
        if item.maps:
            remarks.append("its texture is left out: the table is of white texels")
        result.remarks += [f"{item.id}: {remark}" for remark in remarks]
    return result


def table_of(material: Material, state: MaterialState) -> tuple[ReflectanceTable, list[str]]:
    """The table of a material in a state, and what it cannot hold.

    Raises InvalidValue for an anisotropic material: a MERL table knows no azimuth.
    """
    measured = all(isinstance(layer.model, Measured) for layer in material.layers)
    if measured:
        return edited_table(material, state), []
    for layer in material.layers:
        if layer.model.anisotropic:
            raise InvalidValue(
                f"layer {layer.name} is anisotropic and a MERL table is not; leave the object out"
            )
    settled = conserved(material, state)
    blank = ReflectanceTable(np.zeros((3, *SHAPE)), SCALE)
    wi, wo = (Vector(*(np.broadcast_to(a, SHAPE) for a in w)) for w in blank.directions())
    lit = (wi.z > 0) & (wo.z > 0)
    raw = np.full((3, *SHAPE), BELOW)
    raw[:, lit] = _values(material, settled, wi, wo, lit) / np.asarray(SCALE)[:, None]
    smooth = [
        layer.name for layer in material.layers if is_smooth(layer, settled.layers[layer.name])
    ]
    remarks = [f"the mirror-like layer {name} is left out: no table holds it" for name in smooth]
    return ReflectanceTable(raw, SCALE), remarks


def _values(
    material: Material, state: MaterialState, wi: Vector, wo: Vector, lit: np.ndarray
) -> Float64:
    """ρ of the lit cells, made the same both ways round: float64 [3, n]."""
    light, view = (Vector(*(a[lit] for a in w)) for w in (wi, wo))
    there = reflectance(material, state, light, view)
    back = reflectance(material, state, view, light)
    return np.asarray(np.maximum(0.5 * (there + back), 0.0))
