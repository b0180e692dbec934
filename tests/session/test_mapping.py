"""Which file a map is from, and which of its channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from burnish.core.errors import InvalidValue
from burnish.materials.images.image import ImageMap
from burnish.session import Session
from tests.editor import worlds

PATH = "ball.specular.exponent"


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "picture.png"
    Image.fromarray(np.full((2, 3, 3), (51, 102, 204), np.uint8)).save(path)
    return path


def mapped(session: Session, path: str = PATH) -> ImageMap:
    image = session.map_of(path)
    assert image is not None
    return image


def test_a_file_is_found_in_the_users_folder(
    picture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(picture.parent))
    monkeypatch.setenv("USERPROFILE", str(picture.parent))
    session = worlds.session()
    session.set_map(PATH, "~/picture.png")
    assert mapped(session).source == picture.resolve().as_posix()


def test_another_channel_is_read_from_the_same_file(picture: Path) -> None:
    session = worlds.session()
    session.set_map(PATH, picture, channel="red", scale=2.0, repeat=3.0)
    before = mapped(session)
    session.set_map(PATH, channel="blue")
    image = mapped(session)
    np.testing.assert_allclose(image.texels.values, 204 / 255, rtol=1e-6)
    assert image.channel == "blue"
    assert (image.source, image.scale, image.transform) == (
        before.source, before.scale, before.transform,
    )  # fmt: skip


def test_a_channel_needs_a_file(picture: Path) -> None:
    session = worlds.session()
    with pytest.raises(InvalidValue, match="no map yet"):
        session.set_map(PATH, channel="red")
    session.set_map("ball.diffuse.color", picture)
    with pytest.raises(InvalidValue, match="takes all channels"):
        session.set_map("ball.diffuse.color", channel="red")
