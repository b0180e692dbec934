"""OpenPBR values on a material of ours: the inverse of what an export writes.

| OpenPBR | becomes |
|---|---|
| base_weight × base_color | the matte layer's colour, over a texture its tint; of a metal F0 |
| base_metalness | `principled`'s metallic |
| specular_roughness | the roughness: α is its square |
| specular_ior, specular_weight, specular_color | the coat's or `principled`'s index and strength |
| coat_weight, coat_roughness | `principled`'s coat, which reflects a quarter |
| fuzz_weight | `principled`'s sheen |

What a material has no knob for stays as it is, and is named where the file asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from burnish.core.errors import UnknownName
from burnish.core.types import RGB, Value
from burnish.materials.layer import LayerState, Material, MaterialState
from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.materials.models.optics import SMALLEST_ROUGHNESS
from burnish.materials.models.principled import PrincipledCoat, specular_of_ior
from burnish.materials.names import resolve

Values = Mapping[str, Value]

DEFAULTS: dict[str, Value] = {
    "base_weight": 1.0,
    "base_color": (0.8, 0.8, 0.8),
    "base_diffuse_roughness": 0.0,
    "base_metalness": 0.0,
    "specular_weight": 1.0,
    "specular_color": (1.0, 1.0, 1.0),
    "specular_roughness": 0.3,
    "specular_ior": 1.5,
    "specular_roughness_anisotropy": 0.0,
    "transmission_weight": 0.0,
    "subsurface_weight": 0.0,
    "fuzz_weight": 0.0,
    "coat_weight": 0.0,
    "coat_roughness": 0.0,
    "thin_film_weight": 0.0,
    "emission_luminance": 0.0,
}
"""What an input that a file leaves out is (OpenPBR 1.1), for those that are read or warned of."""

COAT_SHARE = 0.25
"""`principled`'s coat reflects this share of a dielectric's."""


def coat_gloss(roughness: float) -> float:
    """`principled`'s clearcoat_gloss of an OpenPBR coat_roughness."""
    return min(max((0.1 - roughness**2) / 0.099, 0.0), 1.0)


def coat_roughness(gloss: float) -> float:
    """The inverse of `coat_gloss`."""
    return float((0.1 - 0.099 * gloss) ** 0.5)


def apply(
    object_id: str, material: Material, state: MaterialState, given: Values
) -> tuple[MaterialState, list[str]]:
    """The state with OpenPBR's values, and what could not be held, one line each.

    given: the inputs of an `open_pbr_surface`; others have their defaults. Raises InvalidValue
    for a value out of range.
    """
    values = {**DEFAULTS, **given}
    colour = np.asarray(values["base_color"]) * _number(values["base_weight"])
    models = {layer.name: layer.model for layer in material.layers}
    used = {"base_color", "base_weight"}
    wanted: dict[str, Value] = {}
    remarks: list[str] = []
    metal = isinstance(models.get("specular"), CookTorranceConductor)
    if metal:
        used |= {"base_metalness", "specular_color", "specular_ior", "specular_weight"}
        state = _metal(state, colour)
        if _number(values["base_metalness"]) < 1:
            remarks.append("the object is a metal; base_metalness stays 1")
    else:
        wanted["diffuse.color"] = _rgb(colour)
    if isinstance(models.get("coat"), PrincipledCoat):
        used |= {"specular_ior", "specular_weight", "base_metalness", "coat_weight"}
        used |= {"coat_roughness", "fuzz_weight"}
        strength = specular_of_ior(_number(values["specular_ior"]))
        wanted["specular.specular"] = strength * _number(values["specular_weight"])
        wanted["specular.metallic"] = values["base_metalness"]
        wanted["coat.clearcoat"] = _number(values["coat_weight"]) / COAT_SHARE
        wanted["coat.clearcoat_gloss"] = coat_gloss(_number(values["coat_roughness"]))
        wanted["sheen.sheen"] = values["fuzz_weight"]
    elif not metal:
        for name in ("specular_ior", "specular_color", "specular_weight"):
            if _address(object_id, material, name):
                used.add(name)
                wanted[name] = values[name]
        if "specular" not in models and _number(values["specular_weight"]) == 0:
            used |= {"specular_weight", "specular_roughness"}
    if _address(object_id, material, "specular_roughness"):
        used.add("specular_roughness")
        wanted["specular_roughness"] = values["specular_roughness"]
    for name, value in wanted.items():
        state, remark = _set(object_id, material, state, name, value)
        remarks += [remark] if remark else []
    remarks += [
        f"{name} = {_shown(value)} is left out: the object has nothing like it"
        for name, value in given.items()
        if name in DEFAULTS and name not in used and value != DEFAULTS[name]
    ]
    return state, remarks


def _metal(state: MaterialState, colour: np.ndarray) -> MaterialState:
    """A metal with another F0: a tint of the metal that it is, or of one that reflects all."""
    layer = state.layers["specular"]
    eta, k = (np.asarray(layer.values[name], np.float64) for name in ("eta", "k"))
    tint = colour / np.maximum(normal_reflectance(eta, k), 1e-6)
    values = {**layer.values, "color": _rgb(tint)}
    if tint.max() > 1 + 1e-6:
        values |= {"color": _rgb(colour), "eta": (0.0,) * 3, "k": (1.0,) * 3}
    return replace(state, layers={**state.layers, "specular": replace(layer, values=values)})


def normal_reflectance(eta: np.ndarray, k: np.ndarray) -> np.ndarray:
    """F0 of a metal: float64 [3]."""
    return np.asarray(((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2))


def _address(object_id: str, material: Material, name: str) -> bool:
    try:
        resolve({object_id: material}, f"{object_id}.{name}")
    except UnknownName:
        return False
    return True


def _set(
    object_id: str, material: Material, state: MaterialState, name: str, value: Value
) -> tuple[MaterialState, str]:
    """Set one value, limited to what its parameter holds; a remark where that changes it."""
    try:
        address = resolve({object_id: material}, f"{object_id}.{name}")
    except UnknownName:
        return state, f"{name} is left out: the object has no such knob"
    if address.parameter == "weight":
        return address.write(material, state, value), ""
    parameter = material.layer(address.layer).parameter(address.parameter)
    number = _number(value) ** 2 if address.squared else value
    if isinstance(number, tuple):
        held: Value = _rgb(np.clip(number, parameter.minimum, parameter.maximum))
    else:
        held = float(np.clip(_number(number), parameter.minimum, parameter.maximum))
        if address.parameter == "roughness" and held < SMALLEST_ROUGHNESS:
            held = parameter.minimum
    layer: LayerState = state.layers[address.layer]
    checked = parameter.validate(held, f"{object_id}.{address.layer}.")
    changed = replace(layer, values={**layer.values, address.parameter: checked})
    off = np.max(np.abs(np.subtract(held, number)))
    remark = ""
    if off > 1e-6:
        remark = f"{name} = {_shown(number)} is held as {_shown(held)}, the nearest it can be"
    return replace(state, layers={**state.layers, address.layer: changed}), remark


def _number(value: Value) -> float:
    return float(value)  # type: ignore[arg-type]


def _rgb(colour: np.ndarray) -> RGB:
    red, green, blue = (float(c) for c in colour)
    return red, green, blue


def _shown(value: Value) -> str:
    if isinstance(value, tuple):
        return "(" + ", ".join(f"{c:.4g}" for c in value) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
