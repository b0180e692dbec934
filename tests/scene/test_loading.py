"""Scenes load with every shape as an object of its own, from XML and from dictionaries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest

from burnish.core.errors import InvalidValue, SceneError, UnknownName
from burnish.scene import Scene, load

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def write(folder: Path, body: str, name: str = "scene.xml") -> Path:
    path = folder / name
    path.write_text(f'<scene version="3.0.0">\n{body}\n</scene>\n')
    return path


CAMERA = '<sensor type="perspective"/>'
LIGHT = '<emitter type="constant"/>'


def row_of_spheres(count: int) -> str:
    shapes = "".join(
        f'<shape type="sphere"><point name="center" x="{3 * i}" y="0" z="0"/>'
        '<ref id="paint"/></shape>'
        for i in range(count)
    )
    return f'{CAMERA}{LIGHT}<bsdf type="diffuse" id="paint"/>{shapes}'


def hit(scene: Scene, x: float) -> str:
    """Which object a ray down the z axis at x meets, by the table."""
    import mitsuba as mi

    si = scene.mi_scene.ray_intersect(mi.Ray3f(mi.Point3f(x, 0.1, 50), mi.Vector3f(0, 0, -1)))
    number = int(dr.reinterpret_array(mi.UInt32, si.shape)[0])
    return scene.objects[scene.object_table[number]].id


def test_shapes_that_share_a_bsdf_stay_apart(tmp_path: Path) -> None:
    scene = load(write(tmp_path, row_of_spheres(5)))
    assert [item.id for item in scene.objects] == ["paint", *(f"paint_{i}" for i in range(2, 6))]
    assert [hit(scene, 3.0 * i) for i in range(5)] == [item.id for item in scene.objects]
    assert all(item.editable and item.plugin == "diffuse" for item in scene.objects)


def test_equal_meshes_stay_apart(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text(TRIANGLE)
    shape = (
        '<shape type="obj"><string name="filename" value="t.obj"/>'
        '<transform name="to_world"><translate x="{}"/></transform><ref id="paint"/></shape>'
    )
    body = CAMERA + LIGHT + '<bsdf type="diffuse" id="paint"/>' + shape.format(0) + shape.format(3)
    scene = load(write(tmp_path, body))
    assert len(scene.objects) == len(scene.mi_scene.shapes()) == 2
    assert (hit(scene, 0.2), hit(scene, 3.2)) == ("paint", "paint_2")


def test_by_bsdf_makes_one_object_of_them(tmp_path: Path) -> None:
    scene = load(write(tmp_path, row_of_spheres(3)), by_bsdf=True)
    (item,) = scene.objects
    assert (item.id, item.shapes) == ("paint", (0, 1, 2))
    assert {hit(scene, 3.0 * i) for i in range(3)} == {"paint"}


def test_ids_are_the_xml_id_else_the_name_else_the_bsdf_else_the_file(tmp_path: Path) -> None:
    (tmp_path / "leaf.obj").write_text(TRIANGLE)
    body = f"""{CAMERA}{LIGHT}
    <bsdf type="diffuse" id="paint"/>
    <shape type="sphere" id="ball" name="other"><ref id="paint"/></shape>
    <shape type="sphere" name="globe"><ref id="paint"/></shape>
    <shape type="sphere"><ref id="paint"/></shape>
    <shape type="obj"><string name="filename" value="leaf.obj"/></shape>
    <shape type="cube"/><shape type="cube"/>"""
    scene = load(write(tmp_path, body))
    assert [item.id for item in scene.objects] == [
        "ball",
        "globe",
        "paint",
        "leaf",
        "cube",
        "cube_2",
    ]


def test_a_merge_group_is_one_object_for_each_material(tmp_path: Path) -> None:
    body = f"""{CAMERA}{LIGHT}<bsdf type="diffuse" id="wood"/><bsdf type="conductor" id="steel"/>
    <shape type="merge" id="chair">
      <shape type="cube"><ref id="wood"/></shape>
      <shape type="cube"><transform name="to_world"><translate x="5"/></transform>
        <ref id="wood"/></shape>
      <shape type="cube"><transform name="to_world"><translate x="10"/></transform>
        <ref id="steel"/></shape>
    </shape>
    <shape type="merge" id="table">
      <shape type="cube"><transform name="to_world"><translate x="15"/></transform></shape>
    </shape>"""
    scene = load(write(tmp_path, body))
    assert {item.id: len(item.shapes) for item in scene.objects} == {
        "chair-wood": 2,
        "chair-steel": 1,
        "table": 1,
    }
    assert [hit(scene, x) for x in (0, 5, 10, 15)] == [
        "chair-wood",
        "chair-wood",
        "chair-steel",
        "table",
    ]


def test_instances_are_fixed_and_in_the_table(tmp_path: Path) -> None:
    body = f"""{CAMERA}{LIGHT}
    <shape type="cube" id="block"/>
    <shape type="shapegroup" id="tree"><shape type="sphere" id="crown"/></shape>
    <shape type="instance"><ref id="tree"/>
      <transform name="to_world"><translate x="7"/></transform></shape>"""
    scene = load(write(tmp_path, body))
    assert {item.id: item.editable for item in scene.objects} == {"block": True, "crown": False}
    assert "shapegroup" in scene.object("crown").reason
    assert (hit(scene, 0.0), hit(scene, 7.0)) == ("block", "crown")


def test_lights_and_other_bsdfs_are_fixed_with_a_reason() -> None:
    scene = load(
        {
            "type": "scene",
            "eye": {"type": "perspective"},
            "lamp": {"type": "sphere", "glow": {"type": "area"}},
            "glass": {"type": "sphere", "center": [3, 0, 0], "b": {"type": "dielectric"}},
            "wall": {
                "type": "rectangle",
                "b": {"type": "twosided", "inside": {"type": "roughconductor", "alpha": 0.2}},
            },
        }
    )
    assert scene.object("lamp").reason == "it is a light"
    assert "dielectric" in scene.object("glass").reason
    wall = scene.object("wall")
    assert wall.editable
    assert wall.two_sided
    assert wall.plugin == "roughconductor"
    assert wall.edited_bsdf(wall.material.initial) is not None  # type: ignore[union-attr]
    assert [item.id for item in scene.editable()] == ["wall"]
    with pytest.raises(InvalidValue, match="it is a light"):
        scene.editable(["lamp"])
    with pytest.raises(UnknownName, match="'wall'"):
        scene.editable(["wal"])


def test_only_chosen_objects_stay_editable() -> None:
    scene = load("cornell-box", editable=["back", "floor"])
    assert [item.id for item in scene.editable()] == ["floor", "back"]
    assert scene.object("left").reason == "it was not chosen to be editable"


def test_ready_made_objects_of_a_dictionary_are_fixed() -> None:
    import mitsuba as mi

    load("sphere", resolution=(8, 8))  # sets the variant
    scene = load(
        {
            "type": "scene",
            "eye": {"type": "perspective"},
            "sky": {"type": "constant"},
            "shape": mi.load_dict({"type": "sphere"}),
            "cube": {"type": "cube", "bsdf": mi.load_dict({"type": "diffuse"})},
        }
    )
    assert {item.id for item in scene.objects} == {"shape", "cube"}
    assert all("ready-made" in item.reason for item in scene.objects)
    with pytest.raises(SceneError, match="no object can be edited"):
        scene.editable()


def test_defaults_includes_parameters_and_relative_files(tmp_path: Path) -> None:
    (tmp_path / "parts" / "meshes").mkdir(parents=True)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "beside-scene.obj").write_text(TRIANGLE)
    (tmp_path / "parts" / "meshes" / "beside-include.obj").write_text(TRIANGLE)
    write(
        tmp_path / "parts",
        '<default name="alpha" value="0.3"/>'
        '<shape type="obj" id="a"><string name="filename" value="meshes/beside-scene.obj"/>'
        '<bsdf type="roughconductor"><float name="alpha" value="$alpha"/></bsdf></shape>'
        '<shape type="obj" id="b">'
        '<string name="filename" value="meshes/beside-include.obj"/></shape>',
        "shapes.xml",
    )
    path = write(tmp_path, f'{CAMERA}{LIGHT}<include filename="parts/shapes.xml"/>')

    def roughness(scene: Scene) -> Any:
        return scene.object("a").material.initial.layers["specular"].values["roughness"]  # type: ignore[union-attr]

    plain, rougher = load(path), load(path, alpha=0.5)
    assert roughness(plain) == pytest.approx(0.3)
    assert roughness(rougher) == pytest.approx(0.5)
    assert plain.hash == load(path).hash != rougher.hash
    (tmp_path / "meshes" / "beside-scene.obj").write_text(TRIANGLE.replace("1 0 0", "2 0 0"))
    assert plain.hash != load(path).hash


def test_older_scene_versions_load(tmp_path: Path) -> None:
    path = tmp_path / "old.xml"
    path.write_text(
        '<scene version="0.6.0"><sensor type="perspective"><float name="nearClip" value="1"/>'
        f'</sensor>{LIGHT}<shape type="sphere"><bsdf type="roughplastic">'
        '<rgb name="diffuseReflectance" value="0.2, 0.3, 0.4"/></bsdf></shape></scene>'
    )
    values = load(path).objects[0].material.initial.layers["diffuse"].values  # type: ignore[union-attr]
    assert values["color"] == pytest.approx((0.2, 0.3, 0.4))


def test_several_sensors_are_several_views(tmp_path: Path) -> None:
    film = (
        '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="{}"/>'
        '<string name="pixel_format" value="luminance"/><rfilter type="tent"/></film>'
        '<sampler type="multijitter"/>'
    )
    crop = (
        '<film type="hdrfilm"><integer name="crop_width" value="5"/>'
        '<integer name="crop_height" value="4"/><integer name="crop_offset_x" value="2"/></film>'
    )
    body = (
        f'<sensor type="perspective" id="front">{film.format(40, 30)}</sensor>'
        f'<sensor type="thinlens" name="side"><float name="aperture_radius" value="0.1"/>'
        f"{film.format(1, 200)}</sensor>"
        f'<sensor type="orthographic">{crop}</sensor><sensor type="perspective"/>'
        f'{LIGHT}<shape type="sphere"/>'
    )
    scene = load(write(tmp_path, body))
    sizes = {view.name: (view.width, view.height) for view in scene.views}
    assert sizes == {"front": (40, 30), "side": (1, 200), "view": (5, 4), "view_2": (768, 576)}
    assert scene.view().name == "front"
    assert "Tent" in str(scene.view("side").filter)
    assert [view.sensor.id() for view in scene.views] == list(sizes)
    with pytest.raises(UnknownName, match="'front'"):
        scene.view("frond")
    small = load(write(tmp_path, body), resolution=(12, 9))
    assert {(view.width, view.height) for view in small.views} == {(12, 9)}


def test_with_bsdfs_changes_those_objects_and_no_other() -> None:
    import mitsuba as mi

    scene = load("cornell-box", resolution=(16, 16))
    black = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}})
    changed = scene.with_bsdfs({"back": black})
    bsdfs = {shape.id(): shape.bsdf() for shape in changed.shapes()}
    assert bsdfs["back"] == black
    assert sum(bsdf == black for bsdf in bsdfs.values()) == 1
    assert scene.object("back").bsdf != black
    # A first bounce off black is nothing but the filter's tails; everything else is as it was
    direct = mi.load_dict({"type": "path", "max_depth": 2})
    before, after = (
        np.asarray(mi.render(one, integrator=direct, sensor=sensor, spp=4, seed=1))
        for one, sensor in (
            (scene.mi_scene, scene.view().sensor),
            (changed, changed.sensors()[0]),
        )
    )
    middle = (slice(5, 7), slice(9, 11))
    assert before[middle].min() > 0.1
    assert after[middle].max() < 1e-3
    np.testing.assert_allclose(after[-2:], before[-2:], rtol=1e-4)


def test_maps_have_the_mean_over_the_surface() -> None:
    scene = load(
        {
            "type": "scene",
            "eye": {"type": "perspective"},
            "sky": {"type": "constant"},
            "floor": {
                "type": "rectangle",
                "b": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "checkerboard",
                        "color0": {"type": "rgb", "value": [0.8, 0.4, 0.2]},
                        "color1": {"type": "rgb", "value": [0.2, 0.2, 0.2]},
                    },
                },
            },
        }
    )
    (weight_map,) = scene.object("floor").maps.values()
    assert weight_map.mean() == pytest.approx((0.5, 0.3, 0.2), abs=0.6 / 256)


def test_a_medium_is_left_out_with_a_warning(tmp_path: Path) -> None:
    body = (
        f'{CAMERA}{LIGHT}<shape type="sphere" id="jar"><bsdf type="dielectric"/>'
        '<medium type="homogeneous" name="interior"/></shape>'
    )
    scene = load(write(tmp_path, body))
    (warning,) = scene.warnings
    assert "'jar'" in warning
    assert "line 2" in warning
    assert not scene.mi_scene.shapes()[0].is_medium_transition()


@pytest.mark.parametrize(
    "emitter",
    [
        {"type": "constant"},
        {"type": "point"},
        {"type": "spot"},
        {"type": "directional"},
        {"type": "sunsky"},
        {"type": "sunsky", "sun_scale": 0.0},
    ],
    ids=["constant", "point", "spot", "directional", "sunsky", "sky"],
)
def test_every_kind_of_light_loads(emitter: dict[str, Any]) -> None:
    scene = load(
        {
            "type": "scene",
            "eye": {"type": "perspective"},
            "light": emitter,
            "ball": {"type": "sphere"},
        }
    )
    assert len(scene.mi_scene.emitters()) >= 1
