"""Lights of a scene: their names, and descriptions in which they send something else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import RGB
from burnish.materials.lights import (
    MOST_GROUPS,
    Light,
    LightGroup,
    LightState,
    factors,
    grouped,
)
from burnish.scene import Scene, load

FILE = """<scene version="3.0.0">
<sensor type="perspective"><film type="hdrfilm">
  <integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>
<bsdf type="diffuse" id="white"/>
<shape type="sphere" id="lamp"><ref id="white"/>
  <emitter type="area"><spectrum name="radiance" value="2"/></emitter></shape>
<shape type="sphere" id="ball"><ref id="white"/></shape>
<emitter type="point"/>
<emitter type="spot" id="torch"><rgb name="intensity" value="1, 2, 3"/></emitter>
<emitter type="directional"><spectrum name="irradiance" value="400:1, 700:2"/></emitter>
<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
</scene>"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path = tmp_path_factory.mktemp("lights") / "scene.xml"
    path.write_text(FILE)
    return load(path)


def sent(built: Any) -> dict[str, np.ndarray]:
    """What each emitter of a mi.Scene is proportional to, by its place in the scene."""
    found = {}
    for number, emitter in enumerate(built.emitters()):
        for name, value in mi.traverse(emitter):
            if name.endswith(".value") and not name.startswith(("texture", "albedo")):
                found[f"{number} {emitter.id()}"] = np.ravel(np.array(value, np.float64)) * np.ones(
                    3
                )
    return found


def test_names_and_numbers(scene: Scene) -> None:
    names = [light.name for light in scene.lights]
    assert names == ["lamp", "point", "torch", "directional", "environment"]
    emitters = scene.mi_scene.emitters()
    # Other scenes that live in this process have numbers too
    numbers = [int(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(item))[0]) for item in emitters]
    assert sorted(scene.light_table[numbers]) == list(range(len(emitters)))


@pytest.mark.parametrize("factor", [(2.0, 2.0, 2.0), (0.5, 0.25, 0.0), (0.0, 0.0, 0.0)])
def test_every_kind_of_number_is_scaled(scene: Scene, factor: RGB) -> None:
    before = sent(scene.mi_scene)
    assert len(before) == len(scene.lights)
    for light in scene.lights:
        built = scene.with_lights({light.name: factor}).build()
        after = sent(built)
        changed = 0
        for (_, old), (_, new) in zip(before.items(), after.items(), strict=True):
            if np.array_equal(old, new):
                continue
            np.testing.assert_allclose(new, old * factor, rtol=1e-5)
            changed += 1
        assert changed == 1


def test_images_are_scaled_whatever_their_encoding(tmp_path: Path) -> None:
    """An 8-bit picture on a lamp, an EXR round the scene; the files that they came from stay."""
    rng = np.random.default_rng(1)
    picture, around = tmp_path / "picture.png", tmp_path / "around.exr"
    mi.Bitmap(rng.integers(1, 255, (4, 4, 3), np.uint8)).write(str(picture))
    mi.Bitmap(rng.uniform(0.1, 5.0, (8, 16, 3)).astype(np.float32)).write(str(around))
    shown = {"type": "bitmap", "filename": str(picture)}
    scene = load(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
            "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}},
            "screen": {"type": "rectangle", "emitter": {"type": "area", "radiance": shown}},
            "sky": {"type": "envmap", "filename": str(around)},
        }
    )
    factor = (0.5, 2.0, 0.25)
    folder = tmp_path / "scaled"
    folder.mkdir()
    tree = scene.with_lights({"screen": factor, "sky": factor}, folder)
    assert len(list(folder.iterdir())) == 2
    built = tree.build()
    si = dr.zeros(mi.SurfaceInteraction3f, 16)
    texel = dr.arange(mi.UInt32, 16)
    si.uv = (mi.Point2f(texel % 4, texel // 4) + 0.5) / 4
    # For the sky, the way that the light comes from
    si.wi = dr.normalize(mi.Vector3f(si.uv.x - 0.4, si.uv.y - 0.6, 0.5))
    for old, new in zip(scene.mi_scene.emitters(), built.emitters(), strict=True):
        before, after = (np.array(emitter.eval(si)).T for emitter in (old, new))
        assert (before > 0).all()
        np.testing.assert_allclose(after, before * factor, rtol=1e-4)


def test_daylight_is_scaled_and_cannot_be_tinted(scene: Scene) -> None:
    day = load(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
            "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}},
            "day": {"type": "sunsky", "sun_direction": [0, 0, 1]},
        }
    )
    bright = day.with_lights({"day": (3.0, 3.0, 3.0)}).build()
    told = mi.traverse(bright.emitters()[0])
    assert (told["sun_scale"], told["sky_scale"]) == (3.0, 3.0)
    dark = day.with_lights({"day": (0.0, 0.0, 0.0)}).build()
    assert not sent(dark)["0 day"].any()
    with pytest.raises(InvalidValue, match="reset its tint"):
        day.with_lights({"day": (1.0, 0.5, 0.5)})
    with pytest.raises(UnknownName, match="nearest: 'lamp'"):
        scene.with_lights({"lmap": (1.0, 1.0, 1.0)})


LIGHTS = [Light(name) for name in ("key", "fill", "rim", "sky", "back")]


def test_groups_and_what_is_left() -> None:
    groups = grouped(LIGHTS, ["warm=key+fill", "sky"])
    assert [(group.name, group.members) for group in groups] == [
        ("warm", ("key", "fill")),
        ("sky", ("sky",)),
        ("rest", ("rim", "back")),
    ]
    assert [group.name for group in grouped(LIGHTS[:3], ["each"])] == ["key", "fill", "rim"]
    assert grouped(LIGHTS, []) == ()


def test_groups_that_cannot_be() -> None:
    with pytest.raises(InvalidValue, match=rf"at most {MOST_GROUPS}.*got 5.*key=key\+fill"):
        grouped(LIGHTS, ["each"])
    with pytest.raises(InvalidValue, match="got 5"):
        grouped(LIGHTS, ["key", "fill", "rim", "sky"])
    with pytest.raises(UnknownName, match="nearest: 'fill'"):
        grouped(LIGHTS, ["a=key+fil"])
    with pytest.raises(InvalidValue, match="the light 'key' twice"):
        grouped(LIGHTS, ["a=key+fill", "key"])
    with pytest.raises(InvalidValue, match="the group 'a' twice"):
        grouped(LIGHTS, ["a=key", "a=fill"])


def test_a_solo_light_leaves_all_others_dark() -> None:
    """Whether something is set on them, alone or in a group, or nothing is."""
    one, two = LightGroup("key", ("key",)), LightGroup("warm", ("fill", "rim"))
    state = {one.key: LightState(members=("key",), solo=True, intensity=2.0)}
    expected = {"key": (2.0, 2.0, 2.0)}
    dark = dict.fromkeys(("fill", "rim", "sky", "back"), (0.0, 0.0, 0.0))
    assert factors(LIGHTS, state) == expected | dark
    state[two.key] = LightState(members=("fill", "rim"), tint=(1.0, 0.5, 0.0))
    assert factors(LIGHTS, state) == expected | dark
    del state[one.key]
    assert factors(LIGHTS, state) == dict.fromkeys(("fill", "rim"), (1.0, 0.5, 0.0))
    assert factors(LIGHTS, {}) == {}
