"""Layers of a scene given other models before anything is traced."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.coefficients import albedo
from burnish.materials.layer import Material
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.precompute.plan import basis_for
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.transport.basis import initial_state

PLASTIC = {
    "type": "roughplastic",
    "distribution": "ggx",
    "alpha": 0.2,
    "diffuse_reflectance": {"type": "rgb", "value": [0.5, 0.3, 0.2]},
}
COPPER = {"type": "roughconductor", "material": "Cu", "alpha": 0.2, "distribution": "ggx"}


def scene_with(bsdf: dict[str, Any], **options: Any) -> Scene:
    description = {
        "type": "scene",
        "ball": {"type": "sphere", "bsdf": bsdf},
        "sky": {"type": "constant"},
        "lamp": {"type": "point", "position": [2.0, 3.0, 4.0], "intensity": 20.0},
        "camera": {
            "type": "perspective",
            "fov": 30,
            "to_world": _look(),
            "film": {"type": "hdrfilm", "width": 12, "height": 12, "rfilter": {"type": "box"}},
        },
    }
    return load(description, **options)


def _look() -> Any:
    import mitsuba as mi

    from burnish.scene.device import activate

    activate()
    return mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])


def material_of(scene: Scene) -> Material:
    found = scene.object("ball").material
    assert found is not None
    return found


def test_a_metal_over_two_curves_looks_the_same() -> None:
    plain = scene_with(COPPER)
    scene = scene_with(COPPER, models={"ball.specular": "cook-torrance-curves"})
    assert scene.hash != plain.hash
    layer = material_of(scene).layer("specular")
    assert isinstance(layer.model, CookTorranceCurves)
    state = material_of(scene).initial
    own = material_of(plain)
    # The model has one distribution, and so had the scene
    np.testing.assert_allclose(
        albedo(layer, state.layers["specular"]),
        albedo(own.layer("specular"), own.initial.layers["specular"]),
        rtol=5e-3,
    )
    truth = [
        PathTracedTruth(item, 1).render(initial_state(basis_for(item).objects), "camera", 256)
        for item in (plain, scene)
    ]
    # The same model, by Mitsuba and by our own: noise alone
    assert np.linalg.norm(truth[0] - truth[1]) < 0.02 * np.linalg.norm(truth[0])
    assert material_of(scene).initial.replacements == {}


def test_what_a_base_took_from_its_coat_keeps_its_value() -> None:
    plain = material_of(scene_with(PLASTIC))
    changed = material_of(scene_with(PLASTIC, models={"ball.specular": "ashikhmin-shirley-curves"}))
    base, before = changed.layer("diffuse"), plain.layer("diffuse")
    assert base == before
    linked = changed.linked(changed.initial).layers["diffuse"]
    assert linked.values == plain.linked(plain.initial).layers["diffuse"].values
    assert changed.parameters("diffuse") == plain.parameters("diffuse")
    np.testing.assert_allclose(
        albedo(base, linked), albedo(before, plain.linked(plain.initial).layers["diffuse"])
    )
    # Of the coat, what it reflects at normal incidence
    color = changed.initial.layers["specular"].values["color"]
    np.testing.assert_allclose(color, ((1.49 - 1) / (1.49 + 1)) ** 2, rtol=0.01)
    names = [item.name for item in changed.parameters("specular")]
    assert names == ["color", "exponent_u", "exponent_v"]


def test_names_that_are_not_there_are_said() -> None:
    with pytest.raises(UnknownName, match=r"layer.*ball\.gloss"):
        scene_with(COPPER, models={"ball.gloss": "cook-torrance-curves"})
    with pytest.raises(UnknownName, match="reflectance model"):
        scene_with(COPPER, models={"ball.specular": "cook-torrance-curve"})


@pytest.mark.parametrize("model", ["ashikhmin-shirley-curves", "schlick"])
def test_a_picture_that_does_not_carry_over_is_refused(model: str) -> None:
    pattern = {"type": "checkerboard", "color0": 0.1, "color1": 0.4}
    bsdf = {"type": "roughconductor", "alpha": pattern, "material": "Cu"}
    assert material_of(scene_with(bsdf)).initial.images
    with pytest.raises(InvalidValue, match="has a picture for roughness"):
        scene_with(bsdf, models={"ball.specular": model})


def test_a_coat_over_two_curves_keeps_its_index() -> None:
    plain = material_of(scene_with(PLASTIC))
    changed = material_of(scene_with(PLASTIC, models={"ball.specular": "cook-torrance-curves"}))
    values = changed.initial.layers["specular"].values
    ior = plain.initial.layers["specular"].values["ior"]
    assert values["eta"] == (ior, ior, ior)
    assert values["k"] == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(
        albedo(changed.layer("specular"), changed.initial.layers["specular"]),
        albedo(plain.layer("specular"), plain.initial.layers["specular"]),
        rtol=5e-3,
    )
