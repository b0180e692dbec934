"""Paths of what can be edited, OpenPBR's names included."""

from __future__ import annotations

from typing import Any

import pytest

from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.models.cook_torrance import CookTorranceConductor, CookTorranceDielectric
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.names import known, resolve

COAT: dict[str, Any] = {"color": (1.0, 1.0, 1.0), "roughness": 0.16, "ior": 1.5}
BASE: dict[str, Any] = {"color": (0.2, 0.3, 0.4)}
METAL: dict[str, Any] = {
    "color": (1.0, 1.0, 1.0),
    "roughness": 0.1,
    "eta": (0.0, 0.0, 0.0),
    "k": (1.0, 1.0, 1.0),
}

plastic = Material(
    (
        Layer.starting_at("diffuse", PlasticBase(), {**BASE, **COAT}),
        Layer.starting_at("specular", CookTorranceDielectric(), COAT),
    ),
    MaterialState({"diffuse": LayerState(BASE), "specular": LayerState(COAT)}),
    tuple(Link("diffuse", name, "specular", name) for name in ("roughness", "ior")),
)
metal = Material(
    (Layer.starting_at("specular", CookTorranceConductor(), METAL),),
    MaterialState({"specular": LayerState(METAL)}),
)
materials = {"cup": plastic, "cup.handle": metal}


def test_every_known_path_resolves() -> None:
    for path in known(materials):
        address = resolve(materials, path)
        assert path.startswith(address.object + ".")
        address.read(materials[address.object].initial)


@pytest.mark.parametrize(
    ("alias", "layer", "parameter"),
    [
        ("cup.base_color", "diffuse", "color"),
        ("cup.base_weight", "diffuse", "weight"),
        ("cup.specular_color", "specular", "color"),
        ("cup.specular_roughness", "specular", "roughness"),
        ("cup.specular_ior", "specular", "ior"),
        ("cup.handle.base_color", "specular", "color"),
    ],
)
def test_aliases(alias: str, layer: str, parameter: str) -> None:
    address = resolve(materials, alias)
    assert (address.layer, address.parameter) == (layer, parameter)


def test_openpbr_roughness_is_the_root_of_alpha() -> None:
    address = resolve(materials, "cup.specular_roughness")
    assert address.read(plastic.initial) == pytest.approx(0.4)
    edited = address.write(plastic, plastic.initial, 0.5)
    assert edited.layers["specular"].values["roughness"] == pytest.approx(0.25)
    assert resolve(materials, "cup.specular.roughness").read(edited) == pytest.approx(0.25)


def test_write_checks_the_range() -> None:
    ior = resolve(materials, "cup.specular.ior")
    with pytest.raises(InvalidValue, match=r"cup\.specular\.ior must lie in \[1, 3\]; got 9"):
        ior.write(plastic, plastic.initial, 9)
    with pytest.raises(InvalidValue, match=r"cup\.specular_roughness must lie in"):
        resolve(materials, "cup.specular_roughness").write(plastic, plastic.initial, "rough")


@pytest.mark.parametrize(
    ("path", "nearest"),
    [
        ("cup.specular.roughnes", "cup.specular.roughness"),
        ("cpu.specular.ior", "cup.specular.ior"),
        ("cup.diffuse.roughness", "cup.diffuse.color"),
        ("cup.handle.specular_ior", "cup.handle.specular.eta"),
    ],
)
def test_unknown_paths_name_the_nearest(path: str, nearest: str) -> None:
    with pytest.raises(UnknownName) as caught:
        resolve(materials, path)
    assert "nearest" in str(caught.value)
    assert nearest.rsplit(".", 1)[0] in str(caught.value)


def test_the_roughness_of_principled_is_openpbrs() -> None:
    from burnish.materials.models.principled import PrincipledSpecular

    values: dict[str, Any] = {
        "color": (0.5, 0.5, 0.5),
        "metallic": 0.2,
        "roughness": 0.4,
        "specular": 0.5,
        "spec_tint": 0.0,
    }
    layer = Layer.starting_at("specular", PrincipledSpecular(), values)
    car = Material((layer,), MaterialState({"specular": LayerState(values)}))
    address = resolve({"car": car}, "car.specular_roughness")
    assert address.read(car.initial) == 0.4
    assert resolve({"car": car}, "car.base_metalness").read(car.initial) == 0.2
