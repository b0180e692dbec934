"""Brushes: what each does to a material, read off the material's own parameters.

Which brush a material has, and which way a parameter runs, follows from data: a layer whose
profile a scalar widens can be blurred and sharpened, whatever the model calls its parameter
and whether more of it is rougher or sharper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import RGB, Float64
from burnish.materials.coefficients import albedo
from burnish.materials.layer import Layer, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.painting.stroke import WEIGHT, Edit, narrow
from burnish.materials.parameter import Parameter
from burnish.materials.travel import Travel

BrushName = Literal[
    "diffuse-color",
    "specular-intensity",
    "specular-color",
    "sharpen",
    "blur",
    "stretch",
    "metallic",
    "clone",
    "eraser",
]
NAMES: tuple[BrushName, ...] = get_args(BrushName)


@dataclass(frozen=True)
class Brush:
    """A brush as one material has it.

    layers: the layers that it can work on, the first unless another is named. reason: why
    there are none, or "". colour: whether it takes a colour. amount: what it does at full
    strength unless told, and limits: the range of amounts; None where it takes none.
    """

    name: BrushName
    label: str
    layers: tuple[str, ...] = ()
    reason: str = ""
    colour: bool = False
    amount: float | None = None
    limits: tuple[float, float] | None = None
    meaning: str = ""

    @property
    def available(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Wish:
    """What a stroke is asked to do.

    colour: linear RGB. amount: see `Brush.limits`. layer: one of `Brush.layers`. along: the
    cosine squared of the angle between the stroke and the surface's u direction.
    """

    colour: RGB | None = None
    amount: float | None = None
    layer: str | None = None
    along: float = 1.0


def brushes(material: Material, state: MaterialState) -> dict[BrushName, Brush]:
    """The brushes of a material in a state, those that it lacks with the reason."""
    diffuse = _coloured(material, glossy=False)
    shiny = tuple(layer.name for layer in material.layers if _is_glossy(layer))
    found = [
        _brush("diffuse-color", "Diffuse colour", diffuse, "no diffuse layer", colour=True),
        _brush(
            "specular-intensity",
            "Specular intensity",
            shiny,
            "no specular layer",
            amount=0.5,
            limits=(0.0, 4.0),
            meaning="what the highlight is multiplied by",
        ),
        _brush(
            "specular-color",
            "Specular colour",
            _coloured(material, glossy=True),
            "no specular layer with a colour" if shiny else "no specular layer",
            colour=True,
        ),
        *(
            _brush(
                name,
                name.capitalize(),
                tuple(item.name for item in material.layers if _width(material, item)),
                "no parameter that makes its highlight wider or narrower all round"
                if shiny
                else "no specular layer",
                amount=0.25,
                limits=(0.0, 1.0),
                meaning="share of the parameter's whole range",
            )
            for name in ("sharpen", "blur")
        ),
        _brush(
            "stretch",
            "Stretch",
            tuple(item.name for item in material.layers if _stretch(material, item)),
            "no anisotropy that can be edited (Ward and Ashikhmin-Shirley have, in their "
            "ratio form)",
            amount=0.25,
            limits=(-1.0, 1.0),
            meaning="share of the ratio's whole range, along the stroke; below 0 across it",
        ),
        _metallic(material, state),
        Brush("clone", "Clone stamp", tuple(layer.name for layer in material.layers)),
        Brush("eraser", "Eraser", tuple(layer.name for layer in material.layers)),
    ]
    return {item.name: item for item in found}


def edits(brush: Brush, material: Material, state: MaterialState, wish: Wish) -> tuple[Edit, ...]:
    """What a stroke of a brush does to a material. Raises InvalidValue, UnknownName."""
    if not brush.available:
        raise InvalidValue(f"the {brush.label.lower()} brush cannot be used: {brush.reason}")
    layer = material.layer(_chosen_layer(brush, wish))
    amount = _chosen_amount(brush, wish)
    makers: dict[BrushName, Callable[[], tuple[Edit, ...]]] = {
        "diffuse-color": lambda: _colour_edit(brush, layer, wish),
        "specular-color": lambda: _colour_edit(brush, layer, wish),
        "specular-intensity": lambda: (Edit("scale", layer.name, WEIGHT, (amount,)),),
        "sharpen": lambda: (_width_edit(material, state, layer, -amount),),
        "blur": lambda: (_width_edit(material, state, layer, amount),),
        "stretch": lambda: (_stretch_edit(material, state, layer, amount, wish.along),),
        "metallic": lambda: _metallic_edit(material, state, layer, amount),
        "clone": lambda: (Edit("clone"),),
        "eraser": lambda: (Edit("erase"),),
    }
    return makers[brush.name]()


def brush_named(found: dict[BrushName, Brush], name: str) -> Brush:
    """The brush of a name. Raises UnknownName."""
    for key, item in found.items():
        if key == name:
            return item
    raise UnknownName("brush", name, NAMES)


def _brush(
    name: BrushName,
    label: str,
    layers: tuple[str, ...],
    lack: str,
    *,
    colour: bool = False,
    amount: float | None = None,
    limits: tuple[float, float] | None = None,
    meaning: str = "",
) -> Brush:
    reason = "" if layers else f"this material has {lack}"
    return Brush(name, label, layers, reason, colour, amount, limits, meaning)


# -- which way a parameter runs ---------------------------------------------------------------


def _is_glossy(layer: Layer) -> bool:
    return layer.model.lobe == "half" and layer.model.coordinate_name != "none"


def _coloured(material: Material, glossy: bool) -> tuple[str, ...]:
    return tuple(
        layer.name
        for layer in material.layers
        if _is_glossy(layer) == glossy
        and any(
            item.name == "color" and item.kind == "colour"
            for item in material.parameters(layer.name)
        )
    )


def _width(material: Material, layer: Layer) -> tuple[Parameter, float] | None:
    """The parameter that widens a layer's highlight all round, and the sign with which it does."""
    if not _is_glossy(layer):
        return None
    for item in material.parameters(layer.name):
        one_way = item.name == "ratio" or item.name.endswith(("_u", "_v"))
        if layer.model.anisotropic and one_way:
            continue
        sign = _widening(layer.model, tuple(sorted(layer.fixed.items())), item)
        if sign:
            return item, sign
    return None


def _stretch(material: Material, layer: Layer) -> tuple[Parameter, float] | None:
    """The parameter that widens an anisotropic highlight along v, and its sign."""
    if not layer.model.anisotropic:
        return None
    for item in material.parameters(layer.name):
        if item.name == "ratio":
            sign = _widening(layer.model, tuple(sorted(layer.fixed.items())), item)
            return (item, sign) if sign else None
    return None


@lru_cache(maxsize=256)
def _widening(model: Model, fixed: tuple[tuple[str, float], ...], item: Parameter) -> float:
    """1 where more of a scalar makes the profile wider, -1 narrower, 0 neither."""
    if item.kind != "scalar":
        return 0.0
    values = {p.name: p.validate(p.default) for p in model.parameters}
    travel = Travel(item)
    # A fine grid of small angles, where lobes are, and the angle below which half of f lies
    t = np.linspace(0.0, 1.0, 2049) ** 2
    halves = []
    for position in (0.3, 0.7):
        state = {**values, item.name: float(travel.at(position))}
        f = np.abs(model.profile(t, state, dict(fixed))).mean(axis=1)
        halves.append(_half(t, f))
    change = halves[1] - halves[0]
    return float(np.sign(change)) if abs(change) > 1e-3 * max(halves) else 0.0


def _half(t: Float64, f: Float64) -> float:
    """Where half of ∫ f dt lies below."""
    area = np.concatenate([[0.0], np.cumsum((f[1:] + f[:-1]) / 2 * np.diff(t))])
    return float(np.interp(0.5 * area[-1], area, t)) if area[-1] > 0 else 0.0


# -- edits ------------------------------------------------------------------------------------


def _chosen_layer(brush: Brush, wish: Wish) -> str:
    if wish.layer is None:
        return brush.layers[0]
    if wish.layer not in brush.layers:
        raise UnknownName(f"layer for the {brush.label.lower()} brush", wish.layer, brush.layers)
    return wish.layer


def _chosen_amount(brush: Brush, wish: Wish) -> float:
    if brush.amount is None or brush.limits is None:
        return 0.0
    amount = brush.amount if wish.amount is None else float(wish.amount)
    low, high = brush.limits
    if not low <= amount <= high:
        raise InvalidValue(
            f"amount of the {brush.label.lower()} brush must lie in [{low:g}, {high:g}]; "
            f"got {wish.amount!r}"
        )
    return amount


def _colour_edit(brush: Brush, layer: Layer, wish: Wish) -> tuple[Edit, ...]:
    if wish.colour is None:
        raise InvalidValue(f"the {brush.label.lower()} brush needs a color (linear RGB)")
    value = layer.parameter("color").validate(wish.colour, f"{layer.name}.")
    assert isinstance(value, tuple)
    return (Edit("set", layer.name, "color", value),)


def _width_edit(material: Material, state: MaterialState, layer: Layer, amount: float) -> Edit:
    found = _width(material, layer)
    assert found is not None
    return _travel_edit(state, layer, found[0], found[1] * amount)


def _stretch_edit(
    material: Material, state: MaterialState, layer: Layer, amount: float, along: float
) -> Edit:
    found = _stretch(material, layer)
    assert found is not None
    # Wider along v for a stroke along v, along u for one along u
    across = 1 - 2 * min(max(along, 0.0), 1.0)
    return _travel_edit(state, layer, found[0], found[1] * amount * across)


def _travel_edit(state: MaterialState, layer: Layer, item: Parameter, amount: float) -> Edit:
    base = float(Travel(item).of(state.layers[layer.name].values[item.name]))
    return Edit("add", layer.name, item.name, (amount,), base=narrow(min(max(base, 0.0), 1.0)))


def _metallic(material: Material, state: MaterialState) -> Brush:
    """The brush that moves energy between diffuse and specular."""
    name: BrushName = "metallic"
    options = {
        "label": "Metallic-ness",
        "amount": 0.5,
        "limits": (-1.0, 1.0),
        "meaning": "share of the diffuse energy that becomes specular; below 0 the other way",
    }
    own = tuple(
        layer.name
        for layer in material.layers
        if any(item.name == "metallic" for item in material.parameters(layer.name))
    )
    matte = [layer for layer in material.layers if not _is_glossy(layer)]
    shiny = [layer for layer in material.layers if _is_glossy(layer)]
    if own:
        return Brush(name, layers=own[:1], **options)  # type: ignore[arg-type]
    lack = "diffuse" if not matte else "specular" if not shiny else ""
    if lack:
        reason = f"this material has no {lack} layer to move energy to or from"
        return Brush(name, reason=reason, **options)  # type: ignore[arg-type]
    linked = material.linked(state)
    dark = [
        layer.name
        for layer in (matte[0], shiny[0])
        if albedo(layer, linked.layers[layer.name]).mean() <= 0
    ]
    if dark:
        reason = f"its layer {dark[0]} reflects nothing: give it a colour first"
        return Brush(name, reason=reason, **options)  # type: ignore[arg-type]
    return Brush(name, layers=(shiny[0].name,), **options)  # type: ignore[arg-type]


def _metallic_edit(
    material: Material, state: MaterialState, layer: Layer, amount: float
) -> tuple[Edit, ...]:
    for item in material.parameters(layer.name):
        if item.name == "metallic":
            return (_travel_edit(state, layer, item, amount),)
    linked = material.linked(state)
    matte = next(item for item in material.layers if not _is_glossy(item))
    giver, taker = (matte, layer) if amount >= 0 else (layer, matte)
    # So that the light that one layer loses is what the other gains
    lost, gained = (float(albedo(item, linked.layers[item.name]).mean()) for item in (giver, taker))
    value = (abs(amount), lost / gained)
    return (Edit("move", taker.name, WEIGHT, value, source=giver.name),)
