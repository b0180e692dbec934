"""Materials as MERL tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import burnish
from burnish.app.export.merl import table_of
from burnish.app.opening import edits_for
from burnish.core.errors import InvalidValue
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.measured import measured_material, read_merl
from burnish.materials.models.ashikhmin_shirley import AshikhminShirleyWidth
from burnish.materials.reflectance import difference, reflectance, sample_directions
from burnish.scene import Scene


def test_a_table_holds_the_edited_material(room: Scene, tmp_path: Path) -> None:
    session = edits_for(room)
    session.set("metal.specular.roughness", 0.35)
    place = tmp_path / "metal.binary"
    written = burnish.export(room, place, session.materials, objects=["metal"])
    assert written.files == [place]
    assert written.remarks == []
    table = read_merl(place)
    material, state = session.material("metal"), session.materials["metal"]
    assert material is not None
    # At the cells' centres to the last digit of a double
    wi, wo = table.directions()
    lit = (np.broadcast_to(wi.z, table.valid.shape) > 0.2) & (wo.z > 0.2) & table.valid
    chosen = np.flatnonzero(lit)[:: max(lit.sum() // 500, 1)]
    pair = [type(w)(*(np.broadcast_to(a, lit.shape).ravel()[chosen] for a in w)) for w in (wi, wo)]
    values = table.raw.reshape(3, -1)[:, chosen] * np.asarray(table.scale)[:, None]
    np.testing.assert_allclose(values, reflectance(material, state, *pair), rtol=1e-9)
    # And between them as a material again, to the table's resolution
    again = measured_material(table)
    wi, wo, weight = sample_directions()
    found = difference(
        reflectance(material, state, wi, wo), np.stack(table.evaluate(numpy_maths, wi, wo)), weight
    )
    assert found.rms < 0.02
    assert again.layers


def test_what_a_table_cannot_hold_is_said(room: Scene, tmp_path: Path) -> None:
    written = burnish.export(room, tmp_path / "all.binary", objects=["floor", "coated"])
    assert [file.name for file in written.files] == ["all-floor.binary", "all-coated.binary"]
    assert any("floor: its texture is left out" in remark for remark in written.remarks)
    assert any("coated: the mirror-like layer specular" in remark for remark in written.remarks)
    values = {"color": (0.5, 0.5, 0.5), "exponent_u": 10.0, "exponent_v": 40.0}
    model = AshikhminShirleyWidth()
    known = {item.name: values.get(item.name, item.default) for item in model.parameters}
    layer = Layer.starting_at("specular", model, known)
    material = Material((layer,), MaterialState({"specular": LayerState(known)}))
    with pytest.raises(InvalidValue, match="anisotropic"):
        table_of(material, material.initial)
