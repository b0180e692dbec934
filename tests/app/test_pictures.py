"""Pictures on disk and values on the command line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from burnish.app.assignments import parse_assignment, parse_bins, parse_value
from burnish.app.pictures import read_picture, write_picture, write_whole
from burnish.core.colour import colour_from_hex, linear_from_srgb, srgb_from_linear
from burnish.core.errors import CannotWrite, InvalidValue, MissingFile
from burnish.runtime.tonemap import ToneMap


def test_exr_keeps_every_bit(tmp_path: Path) -> None:
    image = np.random.default_rng(0).lognormal(0, 8, (5, 7, 3)).astype(np.float32)
    image[0, 0] = (0, -1, 1e-30)
    write_picture(tmp_path / "a.exr", image)
    np.testing.assert_array_equal(read_picture(tmp_path / "a.exr"), image)


def test_png_holds_srgb(tmp_path: Path) -> None:
    from PIL import Image

    image = np.zeros((1, 4, 3), np.float32)
    image[0, :, :] = np.array([-1.0, 0.5, 1.0, 50.0])[:, None]
    write_picture(tmp_path / "a.png", image)
    with Image.open(tmp_path / "a.png") as picture:
        # Linear 0.5 is sRGB 0.7354
        assert np.asarray(picture)[0, :, 0].tolist() == [0, 188, 255, 255]
    write_picture(tmp_path / "b.png", image, ToneMap(exposure=-1.0))
    with Image.open(tmp_path / "b.png") as picture:
        assert np.asarray(picture)[0, 2, 0] == 188


def test_a_failed_write_leaves_the_old_file_alone(tmp_path: Path) -> None:
    place = tmp_path / "a.png"
    place.write_bytes(b"old")

    def fail(beside: Path) -> None:
        beside.write_bytes(b"half")
        raise OSError(28, os.strerror(28))

    with pytest.raises(CannotWrite, match="No space left"):
        write_whole(place, fail)
    assert place.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [place]


def test_a_new_file_gets_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    write_picture(tmp_path / "a.png", np.zeros((1, 1, 3), np.float32))
    assert (tmp_path / "a.png").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_unreadable_pictures(tmp_path: Path, name: str) -> None:
    with pytest.raises(MissingFile):
        read_picture(tmp_path / name)
    (tmp_path / name).write_bytes(b"not a picture")
    with pytest.raises(InvalidValue, match=name):
        read_picture(tmp_path / name)


@given(st.floats(-4, 4))
def test_srgb_and_linear_are_inverse(value: float) -> None:
    assert linear_from_srgb(srgb_from_linear(value)) == pytest.approx(value, rel=1e-4, abs=1e-6)


def test_colours_are_written_in_srgb() -> None:
    assert colour_from_hex("#fff") == (1.0, 1.0, 1.0)
    assert colour_from_hex("#bc0000") == pytest.approx((0.5029, 0, 0), abs=1e-4)
    assert colour_from_hex("#ff8000") == colour_from_hex("ff8000")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.25", 0.25),
        ("1e-3", 0.001),
        ("0.1, 0.2,0.3", (0.1, 0.2, 0.3)),
        ("#ffffff", (1.0, 1.0, 1.0)),
        ("beckmann", "beckmann"),
        ("skies/dusk, later.exr", "skies/dusk, later.exr"),
    ],
)
def test_values(text: str, value: object) -> None:
    assert parse_value(text) == value
    assert parse_assignment(f"a.b.c = {text}") == ("a.b.c", value)


@pytest.mark.parametrize("text", ["", "a.b.c", "=1", "a.b.c=", "a=1,2", "a=1,b,2", "a=#12345"])
def test_broken_assignments(text: str) -> None:
    with pytest.raises(InvalidValue):
        parse_assignment(text)


def test_bins() -> None:
    assert parse_bins("a=256, b.specular=16") == {"a": 256, "b.specular": 16}
    assert parse_bins(None) == {}
