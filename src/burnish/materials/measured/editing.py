"""Measured data as a material, and an edited material as data again."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64, Value
from burnish.materials.coefficients import (
    conserved,
    edited_profile,
    edited_second_profile,
    outgoing,
)
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
from burnish.materials.measured.pairs import MeasuredHalfDifference, MeasuredHomomorphic
from burnish.materials.measured.register import find, keep, path_of
from burnish.materials.measured.table import ReflectanceTable
from burnish.materials.two_curves import TwoCurves

Angle = Literal["theta_h", "theta_d", "theta_in", "both"]


def measured_material(
    source: ReflectanceTable | str | Path,
    form: Form = "half-difference",
    curve: Angle = "theta_h",
    bins: int = 64,
) -> Material:
    """The material of a table or of a MERL file.

    form: "half-difference" gives the layers "diffuse", edited over θin, and "specular", edited
    over `curve` ("theta_h" or "theta_d"); "homomorphic" gives one layer "measured", edited over
    "theta_h" or "theta_in". With "both" it has two curves (see `two_curves`). A bundle needs the
    file to be where it was.
    Raises InvalidValue, MissingFile, MeasurementError.
    """
    table = source if isinstance(source, ReflectanceTable) else read_merl(source)
    key = keep(table)
    models: dict[str, type[Measured]]
    specular: dict[str, type[Measured]] = {
        "theta_h": MeasuredSpecular,
        "theta_d": MeasuredFresnel,
        "both": MeasuredHalfDifference,
    }
    whole: dict[str, type[Measured]] = {
        "theta_h": MeasuredHalf,
        "theta_in": MeasuredIncident,
        "both": MeasuredHomomorphic,
    }
    if form == "half-difference" and curve in specular:
        models = {"diffuse": MeasuredDiffuse, "specular": specular[curve]}
    elif form == "homomorphic" and curve in whole:
        models = {"measured": whole[curve]}
    else:
        raise InvalidValue(
            "measured data have the forms half-difference over theta_h, theta_d or both, and "
            f"homomorphic over theta_h, theta_in or both; got {form!r} over {curve!r}"
        )
    values: dict[str, Value] = {"color": (1.0, 1.0, 1.0)}
    made = {name: kind(key, path_of(key)) for name, kind in models.items()}
    made = {
        name: model.with_bins(bins, min(bins, 24)) if isinstance(model, TwoCurves) else model
        for name, model in made.items()
    }
    layers = tuple(
        Layer.starting_at(
            name,
            kind,
            values,
            bins=bins if kind.coordinate_name == "theta_h" else min(bins, 24),
            spacing=2.0 if kind.coordinate_name == "theta_h" else 1.0,
        )
        for name, kind in made.items()
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
    if isinstance(model, TwoCurves):
        t, other = model.coordinates(numpy_maths, wi, wo, layer.fixed)
        second = edited_second_profile(layer, state, other)
        ratio = second / model.second_profile(other, state.values, layer.fixed)
    else:
        t, ratio = model.coordinate(numpy_maths, wi, wo, layer.fixed), np.ones((1, 1))
    ratio = ratio * edited_profile(layer, state, t)
    ratio = ratio / model.profile(t, state.values, layer.fixed)
    ratio = ratio * (np.asarray(state.values["color"], np.float64) * state.weight)
    factor = outgoing(layer, state, wo.z, delta=False)
    if factor is not None:
        ratio = ratio * factor
    return np.asarray(share * (ratio.T - 1))
