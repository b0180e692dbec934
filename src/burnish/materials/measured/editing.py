"""Measured data as a material, and an edited material as data again."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64, Value
from burnish.materials.coefficients import conserved, edited_profile, outgoing
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured.factors import Form
from burnish.materials.measured.merl import read_merl
from burnish.materials.measured.models import (
    Measured,
    MeasuredDiffuse,
    MeasuredFresnel,
    MeasuredHalf,
    MeasuredIncident,
    MeasuredSpecular,
)
from burnish.materials.measured.register import find, keep, path_of
from burnish.materials.measured.table import ReflectanceTable

Angle = Literal["theta_h", "theta_d", "theta_in"]


def measured_material(
    source: ReflectanceTable | str | Path,
    form: Form = "half-difference",
    curve: Angle = "theta_h",
    bins: int = 64,
) -> Material:
    """The material of a table or of a MERL file.

    form: "half-difference" gives the layers "diffuse", edited over θin, and "specular", edited
    over `curve` ("theta_h" or "theta_d"); "homomorphic" gives one layer "measured", edited over
    "theta_h" or "theta_in". A bundle needs the file to be where it was.
    Raises InvalidValue, MissingFile, MeasurementError.
    """
    table = source if isinstance(source, ReflectanceTable) else read_merl(source)
    key = keep(table)
    models: dict[str, type[Measured]]
    if form == "half-difference" and curve in ("theta_h", "theta_d"):
        specular = MeasuredSpecular if curve == "theta_h" else MeasuredFresnel
        models = {"diffuse": MeasuredDiffuse, "specular": specular}
    elif form == "homomorphic" and curve in ("theta_h", "theta_in"):
        models = {"measured": MeasuredHalf if curve == "theta_h" else MeasuredIncident}
    else:
        raise InvalidValue(
            "measured data have the forms half-difference over theta_h or theta_d, and "
            f"homomorphic over theta_h or theta_in; got {form!r} over {curve!r}"
        )
    values: dict[str, Value] = {"color": (1.0, 1.0, 1.0)}
    layers = tuple(
        Layer.starting_at(
            name,
            kind(key, path_of(key)),
            values,
            bins=bins if kind.coordinate_name == "theta_h" else min(bins, 24),
            spacing=2.0 if kind.coordinate_name == "theta_h" else 1.0,
        )
        for name, kind in models.items()
    )
    return Material(layers, MaterialState({layer.name: LayerState(values) for layer in layers}))


def edited_table(material: Material, state: MaterialState) -> ReflectanceTable:
    """The table of a measured material in a state; unedited, the original to the bit.

    Every cell is multiplied by what the edit changes at its centre, averaged over both ways
    round, since a table is reciprocal and an edit of one direction's curve is not. Invalid
    cells stay as they are. Raises InvalidValue for a material that is not measured.
    """
    models = [layer.model for layer in material.layers]
    if not models or not all(isinstance(model, Measured) for model in models):
        raise InvalidValue("only materials that `measured_material` made can be tables again")
    model = models[0]
    assert isinstance(model, Measured)
    table = find(model.table, model.path)
    settled = conserved(material, state)
    raw = table.raw.copy()
    wi, wo = table.directions()
    wi, wo = (Vector(*(np.broadcast_to(a, table.valid.shape) for a in w)) for w in (wi, wo))
    lit = table.valid & (wi.z > 0) & (wo.z > 0)
    wi, wo = (Vector(*(a[lit] for a in w)) for w in (wi, wo))
    gain = np.ones((3, len(wi.z)))
    for layer in material.layers:
        for light, view in ((wi, wo), (wo, wi)):
            gain += 0.5 * _change(layer, settled.layers[layer.name], light, view)
    raw[:, lit] *= np.maximum(gain, 0.0)
    result = ReflectanceTable(raw, table.scale)
    keep(result)
    return result


def _change(layer: Layer, state: LayerState, wi: Vector, wo: Vector) -> Float64:
    """share · (edited term / measured term − 1): float64 [3, n], exactly 0 where unedited."""
    model = layer.model
    assert isinstance(model, Measured)
    share = np.stack(model.share(numpy_maths, wi, wo))
    if not state.enabled:
        return -share
    t = model.coordinate(numpy_maths, wi, wo, layer.fixed)
    ratio = edited_profile(layer, state, t) / model.profile(t, state.values, layer.fixed)
    ratio = ratio * (np.asarray(state.values["color"], np.float64) * state.weight)
    factor = outgoing(layer, state, wo.z, delta=False)
    if factor is not None:
        ratio = ratio * factor
    return np.asarray(share * (ratio.T - 1))
