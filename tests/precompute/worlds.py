"""Small scenes that each hold one thing which a symbolic path tracer can get wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.lambert import Lambert
from burnish.materials.pca.models import BlinnPhongComponents, CookTorranceComponents
from burnish.scene import Scene
from burnish.scene.maps import WeightMap
from tests.reference.worlds import SKY, blinn, camera, lambert, material, plane, world

RED, GREY, BLUE = (0.6, 0.2, 0.1), (0.5, 0.5, 0.5), (0.1, 0.2, 0.7)
GREEN = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.3, 0.6, 0.3]}}


def lamp(radiance: float = 4.0, size: float = 0.7, z: float = 3.5) -> dict[str, Any]:
    return plane(z=z, size=size, down=True, emitter={"type": "area", "radiance": radiance})


def wall(**fields: Any) -> dict[str, Any]:
    T = mi.ScalarTransform4f()
    place = T.translate([0, 2, 2]) @ T.rotate([1, 0, 0], 90) @ T.scale(2)
    return {"type": "rectangle", "to_world": place, "bsdf": GREEN, **fields}


VIEW = ((1.0, -5.0, 2.0), (0.0, 1.0, 0.8))


def corner(
    materials: Mapping[str, Material],
    others: Mapping[str, Any] | None = None,
    *,
    floor: Mapping[str, Any] | None = None,
    wall_fields: Mapping[str, Any] | None = None,
    lights: Mapping[str, Any] | None = None,
    side: int = 24,
    rfilter: str = "box",
) -> Scene:
    """A floor and a wall that see each other, a lamp behind the camera and a dim sky."""
    lights = {"lamp": lamp(), "sky": {**SKY, "radiance": 0.2}} if lights is None else lights
    return world(
        {
            "floor": plane(size=2.0, **(floor or {})),
            "wall": wall(**(wall_fields or {})),
            **(others or {}),
            **lights,
            "view": camera(*VIEW, fov=35, rfilter=rfilter),
        },
        materials,
        resolution=(side, side),
    )


def glossy(side: int = 24, exponent: float = 30.0) -> Scene:
    """Two editable objects, each matte and glossy, that see themselves in each other."""
    return corner(
        {"floor": blinn(GREY, GREY, exponent), "wall": blinn(RED, GREY, exponent)}, side=side
    )


def ball(x: float, y: float, radius: float, bsdf: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "sphere", "center": [x, y, radius], "radius": radius, "bsdf": bsdf}


def behind_glass(side: int = 24) -> Scene:
    """A glass ball and a pane of glass between the camera and an editable floor and wall."""
    T = mi.ScalarTransform4f()
    pane = {
        "type": "cube",
        "to_world": T.translate([-0.6, -1.0, 1.0])
        @ T.rotate([0, 0, 1], 20)
        @ T.scale([0.6, 0.04, 1]),
        "bsdf": {"type": "dielectric"},
    }
    return corner(
        {"floor": blinn(GREY, GREY, 60.0), "wall": blinn(RED, GREY, 60.0)},
        {"ball": ball(0.6, -0.4, 0.6, {"type": "dielectric"}), "pane": pane},
        lights={"lamp": lamp(), "sky": {**SKY, "radiance": 1.0}},
        side=side,
    )


def in_a_mirror(side: int = 24) -> Scene:
    """The wall and the ball are mirrors that show an editable glossy floor."""
    return corner(
        {"floor": blinn(RED, GREY, 200.0)},
        {"ball": ball(-0.4, 0.3, 0.7, {"type": "conductor", "material": "Au"})},
        wall_fields={"bsdf": {"type": "conductor", "material": "none"}},
        side=side,
    )


def beside_rough_things(side: int = 24) -> Scene:
    """Fixed objects of every roughness: they show the edited floor by its indirect rows."""
    return corner(
        {"floor": blinn(RED, GREY, 60.0)},
        {
            "rough": ball(-0.7, 0.3, 0.5, {"type": "roughconductor", "alpha": 0.4}),
            "shiny": ball(0.4, 0.5, 0.5, {"type": "roughconductor", "alpha": 0.08}),
            "plastic": ball(0.2, -0.9, 0.3, {"type": "roughplastic", "alpha": 0.2}),
        },
        side=side,
    )


def textured(side: int = 24) -> Scene:
    """A floor whose matte layer has a texture and whose gloss has none: two groups."""
    base = blinn((0.8, 0.8, 0.8), GREY, 60.0)
    matte, gloss = base.layers
    material = replace(base, layers=(replace(matte, group="diffuse"), gloss))
    scene = corner({"floor": material, "wall": blinn(RED, GREY, 20.0)}, side=side)
    colours = np.array([[[1, 0.2, 0.1], [0.1, 0.9, 0.3]], [[0.2, 0.3, 1], [0.9, 0.9, 0.2]]])
    texture = mi.load_dict(
        {
            "type": "bitmap",
            "bitmap": mi.Bitmap(colours.astype(np.float32)),
            "raw": True,
            "to_uv": mi.ScalarTransform3f().scale([3, 3]),
        }
    )
    number = [item.id for item in scene.objects].index("floor")
    shape = scene.mi_scene.shapes()[scene.objects[number].shapes[0]]
    weights = {"diffuse": WeightMap(texture, scene.mi_scene, (shape,))}
    objects = list(scene.objects)
    objects[number] = replace(objects[number], maps=weights)
    return replace(scene, objects=tuple(objects))


def three_layers(side: int = 24) -> Scene:
    """A matte layer under a broad and a narrow gloss, met again and again in a corner."""
    layers = (
        ("diffuse", Lambert(), {"color": RED}),
        ("broad", BlinnPhong(), {"color": (0.2, 0.2, 0.3), "exponent": 8.0}),
        ("narrow", BlinnPhong(), {"color": (0.3, 0.2, 0.2), "exponent": 150.0}),
    )
    item = Material(
        tuple(Layer.starting_at(name, model, values) for name, model, values in layers),
        MaterialState({name: LayerState(values) for name, _, values in layers}),
    )
    return corner({"floor": item, "wall": lambert(BLUE)}, side=side)


def by_components(side: int = 24) -> Scene:
    """Gloss by principal components, whose terms have both signs, on a floor and a wall."""
    sharp = {"color": (0.2, 0.15, 0.1), "exponent": 120.0}
    broad = {"color": (0.3, 0.6, 0.6), "roughness": 0.3, "f0": 0.2}
    floor = material(
        ("diffuse", Lambert(), {"color": RED}), ("specular", BlinnPhongComponents(), sharp)
    )
    wall = material(("specular", CookTorranceComponents(error=0.01), broad))
    return corner({"floor": floor, "wall": wall}, side=side)


def over_two_curves(side: int = 24) -> Scene:
    """A metal whose Fresnel curve is a curve too, and both axes of a brushed wall."""
    copper = {"eta": (0.2, 0.924, 1.102), "k": (3.912, 2.452, 2.142)}
    floor = material(
        ("diffuse", Lambert(), {"color": RED}),
        (
            "specular",
            CookTorranceCurves(bins2=6),
            {"color": (0.6, 0.6, 0.6), "roughness": 0.3, **copper},
        ),
    )
    brushed = {"color": (0.3, 0.6, 0.6), "exponent_u": 60.0, "exponent_v": 6.0}
    wall = material(("specular", AshikhminShirleyCurves(bins2=12), brushed))
    return corner({"floor": floor, "wall": wall}, side=side)


def under_small_lights(side: int = 24) -> Scene:
    """Lights of no size: a point, a spot and a sun."""
    T = mi.ScalarTransform4f()
    lights = {
        "point": {"type": "point", "position": [-1.0, -1.5, 2.0], "intensity": 3.0},
        "spot": {
            "type": "spot",
            "to_world": T.look_at(origin=[1.5, -1, 3], target=[0.3, 0.5, 0], up=[0, 1, 0]),
            "intensity": 20.0,
            "cutoff_angle": 25,
        },
        "sun": {"type": "directional", "direction": [0.3, 0.5, -1], "irradiance": 0.5},
    }
    return corner(
        {"floor": blinn(GREY, GREY, 40.0), "wall": blinn(RED, GREY, 40.0)}, lights=lights, side=side
    )


def under_an_environment(side: int = 24) -> Scene:
    """An environment map with a bright window, and an area light."""
    rng = np.random.default_rng(3)
    sky = rng.uniform(0.1, 0.5, (16, 32, 3))
    sky[3:6, 5:9] = (12.0, 10.0, 8.0)
    lights = {
        "window": {
            "type": "envmap",
            "bitmap": mi.Bitmap(sky.astype(np.float32)),
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90),
        },
        "lamp": lamp(),
    }
    return corner(
        {"floor": blinn(GREY, GREY, 40.0), "wall": blinn(RED, GREY, 40.0)}, lights=lights, side=side
    )


def under_sun_and_sky(side: int = 24) -> Scene:
    """Mitsuba's daylight, sun disk included."""
    light = {
        "type": "sunsky",
        "sun_direction": [-0.4, -0.6, 0.6],
        "turbidity": 4.0,
        "sun_scale": 0.01,
        "to_world": mi.ScalarTransform4f(),
    }
    return corner(
        {"floor": blinn(GREY, GREY, 40.0), "wall": blinn(RED, GREY, 40.0)},
        lights={"day": light},
        side=side,
    )


def seen_from_both_sides(side: int = 24) -> Scene:
    """A two-sided glossy sheet in front of a one-sided floor, under a wide filter."""
    T = mi.ScalarTransform4f()
    sheet = {
        "type": "rectangle",
        "to_world": T.translate([0.0, 0.0, 0.8]) @ T.rotate([0, 1, 0], 60) @ T.scale(0.7),
        "bsdf": {"type": "diffuse"},
    }
    scene = corner(
        {"floor": lambert(GREY), "sheet": blinn(RED, GREY, 30.0)},
        {"sheet": sheet},
        side=side,
        rfilter="gaussian",
    )
    objects = tuple(
        replace(item, two_sided=True) if item.id == "sheet" else item for item in scene.objects
    )
    return replace(scene, objects=objects)


def metals(side: int = 24, roughness: tuple[float, float] = (0.3, 0.0)) -> Scene:
    """A flat rough metal with a delta column, and a smooth one: masking and mirrors."""
    eta, k = (0.2, 0.9, 1.1), (3.9, 2.4, 2.2)
    floor, wall = (
        material(
            (
                "specular",
                CookTorranceConductor("ggx"),
                {"color": GREY, "roughness": alpha, "eta": eta, "k": k},
            ),
            delta=True,
        )
        for alpha in roughness
    )
    return corner({"floor": floor, "wall": wall}, side=side)


def rough_metals(side: int = 24) -> Scene:
    """Metals whose reflections of each other are broad enough for a Z-test of pixels."""
    return metals(side, (0.3, 0.2))
