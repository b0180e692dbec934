"""What people type for a value: `OBJECT.LAYER.PARAMETER=VALUE`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from burnish.core.colour import colour_from_hex
from burnish.core.errors import InvalidValue
from burnish.core.types import Value


def parse_assignment(text: str) -> tuple[str, Value]:
    """Path and value of one `--set`. Raises InvalidValue.

    A value is a number (0.3), three numbers in linear RGB (0.8,0.1,0.1), an sRGB colour
    (#c83c28) or a word (a choice). What the parameter takes is checked where it is known.
    """
    path, equals, written = text.partition("=")
    path, written = path.strip(), written.strip()
    if not (equals and path and written):
        raise InvalidValue(
            f"--set takes OBJECT.LAYER.PARAMETER=VALUE, like teapot.specular.roughness=0.2; "
            f"got {text!r}"
        )
    return path, parse_value(written)


def parse_value(text: str) -> Value:
    """A number, a colour or place, or a word. Raises InvalidValue for a broken colour."""
    if text.startswith("#"):
        return colour_from_hex(text)
    numbers = [_number(part) for part in text.split(",")]
    if not any(number is not None for number in numbers):
        # A choice, or the path of a file, which may hold commas
        return text
    if len(numbers) == 1 and numbers[0] is not None:
        return numbers[0]
    red, green, blue = (*numbers, None, None)[:3]
    if len(numbers) != 3 or red is None or green is None or blue is None:
        raise InvalidValue(
            f"a colour is three numbers in linear RGB, like 0.8,0.1,0.1, or #rrggbb, and a place "
            f"three numbers too; got {text!r}"
        )
    return red, green, blue


def parse_look(text: str) -> tuple[str | None, str, str | None]:
    """Object, file and material of one `--materialx [OBJECT=]FILE[#MATERIAL]`.

    Object and material are None where they are left out. Raises InvalidValue.
    """
    object_id, equals, rest = text.rpartition("=")
    file, _, material = rest.partition("#")
    if not file.strip() or (equals and not object_id.strip()):
        raise InvalidValue(
            f"--materialx takes [OBJECT=]FILE[#MATERIAL], like teapot=looks.mtlx#gold; got {text!r}"
        )
    return object_id.strip() or None, file.strip(), material.strip() or None


def parse_map(text: str) -> tuple[str, str | None, dict[str, Any]]:
    """Path, file and options of one `--set-map`. Raises InvalidValue.

    The options are those of `Session.set_map`; the file is None where it is left out.
    """
    path, equals, rest = text.partition("=")
    if not (equals and path.strip() and rest.strip()):
        raise InvalidValue(
            "--set-map takes OBJECT.LAYER.PARAMETER=FILE, like floor.diffuse.color=oak.jpg,repeat=4"
            f"; got {text!r}"
        )
    # A file's name may hold commas, and equal signs
    parts, options = rest.split(","), dict[str, Any]()
    while parts:
        key, equals, value = parts[-1].partition("=")
        if not equals or key.strip() not in _MAP_OPTIONS:
            break
        options[key.strip()] = _MAP_OPTIONS[key.strip()](value.strip(), text)
        parts.pop()
    return path.strip(), ",".join(parts).strip() or None, options


def _pair(text: str, where: str) -> tuple[float, float]:
    """Two numbers "4x2", or one for both."""
    numbers = [_number(part) for part in text.lower().split("x")]
    if len(numbers) not in (1, 2) or None in numbers:
        raise InvalidValue(f"{where}: {text!r} must be a number or two, like 4x2")
    return numbers[0], numbers[-1]  # type: ignore[return-value]


def _one(text: str, where: str) -> float:
    number = _number(text)
    if number is None:
        raise InvalidValue(f"{where}: {text!r} must be a number")
    return number


def _word(text: str, where: str) -> str:
    return text


_MAP_OPTIONS: dict[str, Callable[[str, str], Any]] = {
    "scale": _one,
    "offset": _one,
    "repeat": _pair,
    "rotate": _one,
    "shift": _pair,
    "wrap": _word,
    "channel": _word,
}


def parse_models(texts: Iterable[str]) -> dict[str, str]:
    """Models by layer: "teapot.specular=cook-torrance-curves" each. Raises InvalidValue."""
    result: dict[str, str] = {}
    for text in texts:
        path, equals, model = text.partition("=")
        if not (equals and path.strip() and model.strip()):
            raise InvalidValue(
                "--model takes OBJECT.LAYER=MODEL, like teapot.specular=cook-torrance-curves; "
                f"got {text!r}"
            )
        result[path.strip()] = model.strip()
    return result


def parse_bins(text: str | None) -> dict[str, int]:
    """Numbers of bins by object or layer: "A=256,B.specular=16". Raises InvalidValue."""
    result: dict[str, int] = {}
    for part in split_list(text):
        name, equals, count = part.partition("=")
        if not (equals and name.strip() and count.strip().isdecimal()):
            raise InvalidValue(
                f"--bins takes OBJECT=NUMBER,…, like teapot=256,tray=16; got {part!r}"
            )
        result[name.strip()] = int(count)
    return result


def parse_series(text: str) -> tuple[int, ...]:
    """Bins per bounce: "64,1,1,1". Raises InvalidValue."""
    parts = split_list(text)
    if not parts or not all(part.isdecimal() for part in parts):
        raise InvalidValue(f"--series takes whole numbers, like 64,1,1,1; got {text!r}")
    return tuple(int(part) for part in parts)


def parse_resolution(text: str | None) -> tuple[int, int] | None:
    """Width and height in pixels: "640x360". Raises InvalidValue."""
    if text is None:
        return None
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise InvalidValue(f"--resolution takes WIDTHxHEIGHT, like 640x360; got {text!r}")
    return int(width), int(height)


def split_list(text: str | None) -> list[str]:
    """The parts of a comma-separated list, blanks left out."""
    return [part.strip() for part in (text or "").split(",") if part.strip()]


def parse_assignments(texts: Iterable[str]) -> list[tuple[str, Value]]:
    """Every `--set` of a command line, in order."""
    return [parse_assignment(text) for text in texts]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
