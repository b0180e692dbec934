"""Messages: what is well formed comes back as it was, what is not is refused by name."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from burnish.app import messages as m
from burnish.app.server.frames import Frame, Kind, halves, read
from burnish.app.server.wire import decode, encode
from burnish.core.errors import InvalidValue

REPOSITORY = Path(__file__).resolve().parent.parent.parent
CURVE = m.CurveData("gain", "cubic", (0.0, 1.0), ((1.0, 1.0, 1.0), (0.5, 0.5, 0.5)))
EXAMPLES: tuple[m.ClientMessage, ...] = (
    m.Hello(1, 1, "page"),
    m.Watch(2, ("front", "side")),
    m.Select(3, ()),
    m.SetValue(4, "ball.diffuse.color", (0.1, 0.2, 0.3)),
    m.SetValue(4, "ball.specular.exponent", 12.0),
    m.SetValue(4, "ball.specular.distribution", "ggx"),
    m.SetCurve(5, "ball.specular", CURVE),
    m.SetCurve(5, "ball.specular", None),
    m.Gesture(6, True),
    m.Reset(7, None),
)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: type(message).__name__)
def test_a_message_survives_the_way_there(message: m.ClientMessage) -> None:
    text = json.dumps({"type": type(message).__name__, **dataclasses.asdict(message)})
    assert decode(text) == message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[]", "JSON object"),
        ('{"seq": 1}', "unknown"),
        ('{"type": "Destroy", "seq": 1}', "unknown"),
        ('{"type": "State", "seq": 1}', "unknown"),
        ('{"type": ["Undo"], "seq": 1}', "unknown"),
        ('{"type": "Undo"}', "lacks the field 'seq'"),
        ('{"type": "Undo", "seq": 1, "extra": 2}', "no field 'extra'"),
        ('{"type": "Undo", "seq": "1"}', "whole number"),
        ('{"type": "Undo", "seq": true}', "whole number"),
        ('{"type": "Undo", "seq": 1.5}', "whole number"),
        ('{"type": "SetValue", "seq": 1, "path": 3, "value": 1}', "path must be text"),
        ('{"type": "SetValue", "seq": 1, "path": "a", "value": [1, 2]}', "value"),
        ('{"type": "SetValue", "seq": 1, "path": "a", "value": {"r": 1}}', "value"),
        ('{"type": "SetWeight", "seq": 1, "layer": "a", "weight": NaN}', "finite"),
        ('{"type": "SetWeight", "seq": 1, "layer": "a", "weight": 1e999}', "finite"),
        ('{"type": "SetWeight", "seq": 1, "layer": "a", "weight": ' + "9" * 400 + "}", "finite"),
        ('{"type": "SetEnabled", "seq": 1, "layer": "a", "enabled": 1}', "true or false"),
        (
            '{"type": "SetCurve", "seq": 1, "layer": "a", '
            '"curve": {"mode": "add", "interpolation": "cubic", "t": [], "values": []}}',
            "null",
        ),
    ],
)
def test_a_malformed_message_is_refused(text: str, words: str) -> None:
    with pytest.raises(InvalidValue, match=words):
        decode(text)


@given(st.text(max_size=200))
def test_no_text_does_anything_but_be_refused(text: str) -> None:
    try:
        decode(text)
    except InvalidValue:
        return
    raise AssertionError("random text was taken for a message")


def test_what_the_server_sends_names_its_type() -> None:
    data = json.loads(encode(m.Notice("info", "words")))
    assert data == {"type": "Notice", "level": "info", "text": "words", "offer": ""}


def test_the_page_has_the_same_types() -> None:
    script = REPOSITORY / "client" / "message_types.py"
    done = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("deflate", [False, True])
@pytest.mark.parametrize("kind", [Kind.PICTURE, Kind.OBJECTS])
def test_a_frame_survives_either_codec(kind: Kind, deflate: bool) -> None:
    channels = 3 if kind == Kind.PICTURE else 1
    pixels = np.random.default_rng(4).integers(0, 65536, (7, 5, channels)).astype(np.uint16)
    frame = Frame(kind, 1, 22, 333, pixels)
    again = read(frame.deflated if deflate else frame.raw)
    assert (again.kind, again.view, again.number, again.revision) == (kind, 1, 22, 333)
    assert np.array_equal(again.pixels, pixels)


def test_halves_keep_eleven_bits_and_clip_what_is_beyond() -> None:
    rng = np.random.default_rng(5)
    image = np.exp(rng.normal(0.0, 3.0, (9, 8, 3))).astype(np.float32)
    image[0, 0] = (np.inf, np.nan, 1e9)
    result = halves(image).view(np.float16).astype(np.float64)
    assert result[0, 0].tolist() == [65504.0, 0.0, 65504.0]
    rest = (slice(1, None),)
    assert np.allclose(result[rest], image[rest], rtol=2**-11, atol=2**-24)
