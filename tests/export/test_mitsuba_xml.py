"""Exported Mitsuba XML renders in stock Mitsuba, and says how far it is off where it must."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.app.export.closest import closest
from burnish.app.export.files import Folder, Textures, evaluated
from burnish.app.opening import edits_for
from burnish.core.errors import InvalidValue, MissingFile
from burnish.materials.curve import Curve
from burnish.materials.reflectance import difference, reflectance, sample_directions
from burnish.scene import Scene, load
from burnish.scene.reader import rgb
from burnish.scene.textures import Factor, product
from burnish.session import Session
from tests.export.conftest import Fresh, checks, own

DRAWN = Curve((0.0, 0.3, 1.0), ((2.0, 1.0, 0.5), (0.5, 0.5, 0.5), (0.0, 0.0, 0.0)))


@pytest.fixture
def session(room: Scene) -> Session:
    return edits_for(room)


def edit_all(session: Session) -> None:
    """Edits that Mitsuba's own plugins hold, one of every object.

    A grey tint: of a coloured one the means, which only shape the samples, are not the same.
    """
    session.set("floor.diffuse.color", (0.6, 0.6, 0.6))
    session.set("floor.specular.roughness", 0.1)
    session.set("coated.specular.ior", 1.7)
    session.set("metal.specular.roughness", 0.35)
    session.set("burley.specular.roughness", 0.2)
    session.set("burley.coat.clearcoat", 0.6)
    session.set("leaf.diffuse.color", (0.2, 0.7, 0.2))


def test_a_fresh_process_renders_the_truth(
    room: Scene, session: Session, fresh: Fresh, tmp_path: Path
) -> None:
    """The same samples, so that only rounding differs: of tinted texels, to half floats."""
    edit_all(session)
    place = tmp_path / "room.xml"
    written = burnish.export(room, place, session.materials)
    assert written.remarks == []
    ours, theirs = own(room, session.materials), fresh(place)
    assert np.linalg.norm(theirs - ours) <= 1e-3 * np.linalg.norm(ours)
    # Unedited, nothing but the writing of numbers is between them
    plain = tmp_path / "plain.xml"
    burnish.export(room, plain)
    np.testing.assert_allclose(fresh(plain), own(room, {}), rtol=1e-4, atol=1e-5)


def test_the_files_beside_it_move_with_it(room: Scene, session: Session, tmp_path: Path) -> None:
    edit_all(session)
    first, second = tmp_path / "a", tmp_path / "b"
    first.mkdir()
    written = burnish.export(room, first / "room.xml", session.materials)
    assert all(file.is_file() for file in written.files)
    first.rename(second)
    again = load(second / "room.xml")
    assert [item.id for item in again.objects] == [item.id for item in room.objects]
    assert [item.editable for item in again.objects] == [item.editable for item in room.objects]
    found = again.object("metal").material
    assert found is not None
    assert found.initial.layers["specular"].values["roughness"] == pytest.approx(0.35)


def test_what_no_stock_plugin_holds_is_close_and_exact_beside(
    room: Scene, session: Session, fresh: Fresh, tmp_path: Path
) -> None:
    session.set_curve("metal.specular", DRAWN)
    place = tmp_path / "drawn.xml"
    written = burnish.export(room, place, session.materials)
    assert [remark.split(":")[0] for remark in written.remarks] == ["metal"]
    assert all("% RMS over all pairs of directions" in remark for remark in written.remarks)
    data = json.loads((tmp_path / "drawn_files" / "metal.json").read_text())
    assert data["format"] == "burnish-material"
    assert fresh(place).mean() == pytest.approx(own(room, session.materials).mean(), rel=0.05)
    # With the plugin it is the truth itself
    exact = tmp_path / "exact.xml"
    burnish.export(room, exact, session.materials, plugin=True)
    ours, theirs = own(room, session.materials), fresh(exact, plugin=True)
    assert np.linalg.norm(theirs - ours) <= 1e-3 * np.linalg.norm(ours)


TILES = {"type": "checkerboard", "color0": 0.1, "color1": {"type": "rgb", "value": [0.9, 0.5, 0.1]}}


@pytest.mark.parametrize("kind", ["bitmap", "checkerboard", "two maps", "metallic"])
def test_weight_maps_become_stock_textures(tmp_path: Path, kind: str) -> None:
    """Their values at texel centres, to half floats and bilinear interpolation."""
    bitmap = checks(tmp_path / "checks.png")
    maps: dict[str, Any] = {"a": bitmap, "b": TILES}
    tint = (0.9, 0.5, 0.3)
    colours = [("a", tint), ("b", (0.1, 0.2, 0.1))] if kind == "two maps" else [("a", tint)]
    if kind == "checkerboard":
        maps = {"a": TILES}
    if kind == "metallic":
        maps = {"a": product([Factor(bitmap), Factor(bitmap, -0.5, 1.0, single=True)])}
    written = Textures(Folder(tmp_path / "a.xml"), "object", maps)(colours)
    assert "burnish" not in json.dumps(written, default=str)
    expected = sum(evaluated(maps[group], 96) * np.array(colour) for group, colour in colours)
    found = evaluated(written, 96)
    # Texels that straddle an edge of the other grid interpolate differently
    near = np.abs(found - expected) <= 2e-3
    assert near.all() if kind in ("bitmap", "checkerboard") else near.mean() > 0.95, near.mean()


def test_the_closest_stock_material_is_measured(room: Scene) -> None:
    """The scene's own plugin where a drawn curve changes nothing; a fit elsewhere."""
    item = room.object("metal")
    assert item.material is not None
    start = item.material.initial
    flat = Curve((0.0,), ((1.0, 1.0, 1.0),))
    drawn = replace(start.layers["specular"], curve=flat)
    state = replace(start, layers={"specular": drawn})
    found = closest(item, state, plain_colours)
    assert found.difference is not None
    assert found.difference.rms < 1e-3  # three Fresnel terms for three metals
    # Without the scene's own plugin: a metal of another Fresnel curve
    alone = closest(replace(item, factory=None), state, plain_colours)
    assert alone.difference is not None
    assert found.difference.rms < alone.difference.rms < 0.2
    # And it is what Mitsuba makes of it
    wi, wo, weight = sample_directions()
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(mi.Float(c.astype(np.float32)) for c in (wo.x, wo.y, wo.z)))
    light = mi.Vector3f(*(mi.Float(c.astype(np.float32)) for c in (wi.x, wi.y, wi.z)))
    bsdf = mi.load_dict(dict(alone.description))
    shown = np.asarray(bsdf.eval(mi.BSDFContext(), si, light), np.float64) / wi.z
    true = reflectance(item.material, state, wi, wo)
    measured = difference(true, shown, weight)
    assert measured.rms == pytest.approx(alone.difference.rms, abs=1e-3)


def plain_colours(colours: Any) -> dict[str, Any]:
    return rgb(np.sum([colour for _, colour in colours], axis=0))


def test_layers_of_other_models_are_fitted(room: Scene) -> None:
    """Blinn-Phong has no stock plugin; what is written reflects as much light."""
    scene = load("cornell-box", resolution=(16, 16))
    item = scene.object("back")
    assert item.material is not None
    start = item.material.initial
    glossy = replace(start.layers["specular"], weight=0.2)
    state = replace(start, layers={**start.layers, "specular": glossy})
    found = closest(item, state, plain_colours)
    assert found.description["type"] == "blendbsdf"
    assert found.difference is not None
    assert 0.01 < found.difference.rms < 0.3
    assert found.difference.albedo < 1e-6


def test_a_drawn_factor_on_the_viewing_angle_is_not_forgotten(room: Scene) -> None:
    """No plugin of Mitsuba's holds it, so none may stand for the material."""
    item = room.object("metal")
    assert item.material is not None
    start = item.material.initial
    layer = replace(start.layers["specular"], outgoing_curve=DRAWN)
    assert item.described(start) is not None
    assert item.described(replace(start, layers={"specular": layer})) is None


def test_lights_are_exported_as_they_are_mixed(
    room: Scene, session: Session, fresh: Fresh, tmp_path: Path
) -> None:
    from burnish.materials.lights import LightState

    state = {**session.materials, "light:lamp": LightState(members=("lamp",), intensity=0.25)}
    place = tmp_path / "dim.xml"
    assert burnish.export(room, place, state).files[0] == place
    np.testing.assert_allclose(fresh(place), own(room, state), rtol=1e-4, atol=1e-5)


def test_moved_lights_are_exported_where_they_stand(
    room: Scene, session: Session, fresh: Fresh, tmp_path: Path
) -> None:
    from burnish.materials.lights import each

    lamp = next(group for group in each(room.lights) if group.name == "lamp")
    moved = lamp.initial.set("position", (-1.0, -1.5, 2.5), lamp.key)
    moved = moved.set("size", 0.7, lamp.key)
    state = {**session.materials, lamp.key: moved}
    place = tmp_path / "moved.xml"
    burnish.export(room, place, state)
    exported = fresh(place)
    np.testing.assert_allclose(exported, own(room, state), rtol=1e-4, atol=1e-5)
    assert abs(exported - own(room, session.materials)).max() > 0.1


def test_a_scene_with_nothing_to_edit_is_exported_all_the_same(tmp_path: Path) -> None:
    scene = load(
        {
            "type": "scene",
            "glass": {"type": "sphere", "bsdf": {"type": "dielectric"}},
            "sky": {"type": "constant"},
            "view": {"type": "perspective"},
        }
    )
    burnish.export(scene, tmp_path / "glass.xml")
    again = load(tmp_path / "glass.xml")
    assert again.object("glass").plugin == "dielectric"
    with pytest.raises(InvalidValue, match="the scene itself"):
        burnish.export(again, tmp_path / "glass.xml")
    with pytest.raises(InvalidValue, match="no editable material"):
        burnish.export(scene, tmp_path / "glass.mtlx")


def test_bad_requests_say_what_to_do(room: Scene, tmp_path: Path) -> None:
    with pytest.raises(InvalidValue, match=r"\.xml, \.mtlx, \.glb"):
        burnish.export(room, tmp_path / "room.foo")
    with pytest.raises(MissingFile, match="mkdir"):
        burnish.export(room, tmp_path / "no" / "room.xml")
    with pytest.raises(InvalidValue, match="Mitsuba XML alone"):
        burnish.export(room, tmp_path / "room.mtlx", plugin=True)
