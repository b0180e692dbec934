"""Bad scenes: one line, with the place and the remedy."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from burnish.core.errors import (
    BurnishError,
    InvalidValue,
    MissingFile,
    SceneError,
    UnknownName,
)
from burnish.scene import load

CAMERA = '<sensor type="perspective"/>'
LIGHT = '<emitter type="constant"/>'
BALL = '<shape type="sphere"/>'


def mesh(kind: str, name: str) -> str:
    return (
        f'{CAMERA}{LIGHT}\n<shape type="{kind}" id="vase">'
        f'<string name="filename" value="{name}"/></shape>'
    )


@pytest.mark.parametrize(
    ("body", "kind", "parts"),
    [
        ("<shape", SceneError, ["bad.xml", "line 3", "correct the XML"]),
        (CAMERA + BALL, SceneError, ["no light", "add an <emitter>"]),
        (LIGHT + BALL, SceneError, ["no camera", "add a <sensor>"]),
        (CAMERA + LIGHT, SceneError, ["no shapes", "<shape>"]),
        (mesh("obj", "gone.obj"), MissingFile, ["line 3", "gone.obj", "put it there"]),
        (mesh("obj", "text.obj"), SceneError, ["line 3", "'vase'", "export the mesh anew"]),
        (mesh("ply", "short.ply"), SceneError, ["line 3", "'vase'", "export the mesh anew"]),
        (mesh("obj", "nan.obj"), SceneError, ["line 3", "'vase'", "NaN"]),
        (mesh("ply", "nan.ply"), SceneError, ["line 3", "'vase'", "NaN"]),
        (
            CAMERA + LIGHT + '<shape type="spere"/>',
            SceneError,
            ["line 2", "spere", "check the type's spelling"],
        ),
        (
            CAMERA + LIGHT + '<shape type="sphere"><float name="raduis" value="2"/></shape>',
            SceneError,
            ["line 2", "raduis", "remove or correct"],
        ),
        (
            CAMERA + LIGHT + '<shape type="sphere"><float name="radius" value="$r"/></shape>',
            SceneError,
            ["line 2", "$r", "-D name=value"],
        ),
        (
            CAMERA + LIGHT + '<shape type="sphere"><ref id="paint"/></shape>',
            SceneError,
            ["line 2", '"paint"', "define an object"],
        ),
        (CAMERA + LIGHT + '<include filename="gone.xml"/>', MissingFile, ["line 2", "gone.xml"]),
        (
            CAMERA + LIGHT + '<shape type="sphere" id="a"/><shape type="cube" id="a"/>',
            SceneError,
            ["line 2", '"a"', "its own id"],
        ),
        (
            CAMERA + LIGHT + '<shape type="sphere" name="a"/><shape type="cube" name="a"/>',
            SceneError,
            ["line 2", "same name"],
        ),
    ],
)
def test_a_bad_file(tmp_path: Path, body: str, kind: type[BurnishError], parts: list[str]) -> None:
    (tmp_path / "text.obj").write_text("v one two three\n")
    (tmp_path / "short.ply").write_text("ply\n")
    (tmp_path / "nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    vertices = struct.pack("<9f", 0, 0, 0, float("nan"), 0, 0, 0, 1, 0)
    (tmp_path / "nan.ply").write_bytes(header.encode() + vertices + struct.pack("<B3i", 3, 0, 1, 2))
    path = tmp_path / "bad.xml"
    path.write_text(f'<scene version="3.0.0">\n{body}\n</scene>\n')
    with pytest.raises(kind) as caught:
        load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert "cpp" not in message
    for part in parts:
        assert part in message


def test_files_and_names_that_do_not_exist() -> None:
    with pytest.raises(MissingFile, match=r"nowhere\.xml"):
        load("nowhere.xml")
    with pytest.raises(UnknownName, match="'cornell-box'"):
        load("cornel-box")
    with pytest.raises(SceneError, match="not a Mitsuba 3 scene"):
        load("model.obj")


def test_unused_parameters_and_bad_sizes(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{CAMERA}{LIGHT}{BALL}</scene>')
    with pytest.raises(InvalidValue, match=r"no parameter \$radius"):
        load(path, radius=2)
    with pytest.raises(InvalidValue, match="no parameter radius"):
        load("sphere", radius=2)
    for size in ((0, 4), (4, 70000), (4,), "wide"):
        with pytest.raises(InvalidValue, match="resolution must"):
            load(path, resolution=size)  # type: ignore[arg-type]


def test_a_transform_with_nan_names_the_object(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        f'<scene version="3.0.0">{CAMERA}{LIGHT}<shape type="cube" id="box">'
        '<transform name="to_world"><translate x="nan"/></transform></shape></scene>'
    )
    with pytest.raises(SceneError, match="'box'"):
        load(path)
