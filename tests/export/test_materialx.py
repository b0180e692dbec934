"""MaterialX documents: valid, and the way back loses nothing that OpenPBR holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import burnish
from burnish.app.assignments import parse_look
from burnish.app.opening import edits_for
from burnish.core.errors import InvalidValue, MissingFile, UnknownName
from burnish.materials.curve import Curve
from burnish.scene import Scene, load
from burnish.session import Session
from burnish.session.materialx import read_materialx

mx = pytest.importorskip("MaterialX", reason="MaterialX has no wheel here to validate files with")


@pytest.fixture
def session(room: Scene) -> Session:
    return edits_for(room)


def edit_all(session: Session) -> None:
    for path, value in EDITS.items():
        session.set(path, value)


EDITS = {
    "floor.diffuse.color": (0.9, 0.5, 0.7),
    "floor.specular.roughness": 0.1,
    "coated.specular.ior": 1.7,
    "coated.diffuse.color": (0.1, 0.2, 0.3),
    "metal.specular.roughness": 0.35,
    "metal.specular.color": (0.5, 0.8, 0.9),
    "burley.specular.roughness": 0.2,
    "burley.coat.clearcoat": 0.6,
    "burley.coat.clearcoat_gloss": 0.7,
    "burley.sheen.sheen": 0.3,
    "leaf.diffuse.color": (0.2, 0.7, 0.2),
}


def document(path: Path) -> Any:
    """The file with MaterialX's own libraries, as its tools read it."""
    libraries = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), libraries)
    found = mx.createDocument()
    mx.readFromXmlFile(found, str(path))
    found.setDataLibrary(libraries)
    return found


def test_documents_are_valid_and_complete(room: Scene, session: Session, tmp_path: Path) -> None:
    edit_all(session)
    session.set_curve("coated.diffuse", Curve((0.0,), ((0.5, 0.5, 0.5),)))
    place = tmp_path / "room.mtlx"
    written = burnish.export(room, place, session.materials)
    found = document(place)
    valid, said = found.validate()
    assert valid, said
    materials = found.getMaterialNodes()
    names = ["m_floor", "m_coated", "m_metal", "m_burley", "m_leaf"]
    assert [node.getName() for node in materials] == names
    for node in materials:
        (shader,) = mx.getShaderNodes(node)
        assert shader.getNodeDef() is not None
        assert shader.getCategory() in ("open_pbr_surface", "mix")
        for input_ in shader.getInputs():
            assert shader.getNodeDef().getActiveInput(input_.getName()) is not None
    for file in written.files[1:]:
        assert file.is_file()
    assert any(remark.startswith("coated:") and "% RMS" in remark for remark in written.remarks)


def test_the_way_back_is_the_same_state(room: Scene, session: Session, tmp_path: Path) -> None:
    edit_all(session)
    place = tmp_path / "room.mtlx"
    burnish.export(room, place, session.materials)
    again = edits_for(room)
    assert burnish.load_materialx(again, place) == []
    for path in EDITS:
        np.testing.assert_allclose(again.get(path), session.get(path), rtol=1e-6, err_msg=path)
    again.undo()
    assert again.materials == edits_for(room).materials


GOLD = """<?xml version="1.0"?>
<materialx version="1.39">
  <open_pbr_surface name="gold_shader" type="surfaceshader">
    <input name="base_color" type="color3" value="1.0, 0.7, 0.3" />
    <input name="base_metalness" type="float" value="1.0" />
    <input name="specular_roughness" type="float" value="0.5" />
    <input name="coat_weight" type="float" value="1.0" />
  </open_pbr_surface>
  <surfacematerial name="gold" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="gold_shader" />
  </surfacematerial>
  <open_pbr_surface name="alone" type="surfaceshader" />
</materialx>
"""


def test_a_file_by_others(session: Session, tmp_path: Path) -> None:
    place = tmp_path / "gold.mtlx"
    place.write_text(GOLD)
    remarks = burnish.load_materialx(session, place, "burley", "gold")
    assert session.get("burley.specular.metallic") == 1.0
    assert session.get("burley.specular.roughness") == 0.5
    assert session.get("burley.coat.clearcoat") == 1.0
    assert any("coat.clearcoat = 4 is held as 1" in remark for remark in remarks)
    remarks = burnish.load_materialx(session, place, "metal", "gold")
    assert session.get("metal.specular.roughness") == 0.25  # α is its square
    assert any("coat_weight = 1 is left out" in remark for remark in remarks)
    # F0 of the metal that it is, tinted, or of one that reflects everything
    layer = session.materials["metal"].layers["specular"].values
    assert layer["color"] == pytest.approx((1.0, 0.7, 0.3))
    assert layer["k"] == (1.0, 1.0, 1.0)


def test_bad_files_say_what_to_do(session: Session, tmp_path: Path) -> None:
    place = tmp_path / "gold.mtlx"
    with pytest.raises(MissingFile, match=r"no MaterialX file"):
        burnish.load_materialx(session, place, "metal")
    place.write_text(GOLD)
    with pytest.raises(InvalidValue, match="several materials"):
        burnish.load_materialx(session, place, "metal")
    with pytest.raises(InvalidValue, match="names no object"):
        burnish.load_materialx(session, place)
    with pytest.raises(UnknownName, match="'metal'"):
        burnish.load_materialx(session, place, "metl", "gold")
    with pytest.raises(UnknownName, match="'gold'"):
        burnish.load_materialx(session, place, "metal", "golf")
    place.write_text(GOLD.replace("1.0, 0.7, 0.3", "1.0, x"))
    with pytest.raises(InvalidValue, match="base_color is no color3"):
        read_materialx(place)
    place.write_text("<a>")
    with pytest.raises(InvalidValue, match="not XML"):
        read_materialx(place)
    place.write_text("<materialx/>")
    with pytest.raises(InvalidValue, match="no open_pbr_surface"):
        read_materialx(place)


def test_what_is_typed() -> None:
    assert parse_look("a.b=looks.mtlx#gold") == ("a.b", "looks.mtlx", "gold")
    assert parse_look("looks.mtlx") == (None, "looks.mtlx", None)
    with pytest.raises(InvalidValue, match="teapot=looks"):
        parse_look("teapot=")


def test_fitted_blends_are_mixed(tmp_path: Path) -> None:
    scene = load("cornell-box", resolution=(16, 16))
    session = edits_for(scene)
    session.set("back.specular.weight", 0.2)
    place = tmp_path / "box.mtlx"
    burnish.export(scene, place, session.materials, objects=["back"])
    found = document(place)
    assert found.validate()[0]
    (material,) = found.getMaterialNodes()
    (shader,) = mx.getShaderNodes(material)
    assert shader.getCategory() == "mix"
