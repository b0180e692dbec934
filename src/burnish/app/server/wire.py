"""From a message's JSON text to its dataclass and back, checked field by field."""

from __future__ import annotations

import json
import math
import types
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from burnish.app import messages
from burnish.app.messages import CLIENT_MESSAGES, ClientMessage, ServerMessage
from burnish.core.errors import InvalidValue

_BY_NAME = {kind.__name__: kind for kind in CLIENT_MESSAGES}
_LONGEST = 100_000
"""Longest list in a message; longer ones are refused."""


def encode(message: ServerMessage) -> str:
    """One message as JSON text with its type."""
    fields = {"type": type(message).__name__, **vars(message)}
    # A dataclass in a message is its fields
    return json.dumps(fields, separators=(",", ":"), allow_nan=False, default=vars)


def decode(text: str | bytes) -> ClientMessage:
    """The message that `text` holds. Raises InvalidValue that names the field and the rule."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidValue(f"message is not JSON: {error}") from None
    if not isinstance(data, dict):
        raise InvalidValue("message must be a JSON object with a type")
    name = data.pop("type", None)
    kind = _BY_NAME.get(name) if isinstance(name, str) else None
    if kind is None:
        raise InvalidValue(f"message type {name!r:.40} is unknown; reload the page")
    result = _build(kind, data, kind.__name__)
    assert isinstance(result, ClientMessage)
    return result


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, vars(messages))


def _build(kind: Any, data: object, where: str) -> Any:
    if not isinstance(data, dict):
        raise InvalidValue(f"{where} must be an object; got {_short(data)}")
    hints = _hints(kind)
    unknown = data.keys() - hints.keys()
    if unknown:
        raise InvalidValue(f"{where} has no field {sorted(unknown)[0]!r:.40}")
    missing = hints.keys() - data.keys()
    if missing:
        raise InvalidValue(f"{where} lacks the field {sorted(missing)[0]!r}")
    return kind(**{name: _check(hints[name], data[name], f"{where}.{name}") for name in hints})


def _check(hint: Any, value: object, where: str) -> Any:
    if hint is str:
        if isinstance(value, str):
            return value
        raise InvalidValue(f"{where} must be text; got {_short(value)}")
    if hint is bool:
        if isinstance(value, bool):
            return value
        raise InvalidValue(f"{where} must be true or false; got {_short(value)}")
    if hint is int:
        if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53:
            return value
        raise InvalidValue(f"{where} must be a whole number; got {_short(value)}")
    if hint is float:
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            if math.isfinite(number):
                return number
        raise InvalidValue(f"{where} must be a finite number; got {_short(value)}")
    if hint is types.NoneType:
        if value is None:
            return None
        raise InvalidValue(f"{where} must be null; got {_short(value)}")
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Literal:
        if value in arguments:
            return value
        raise InvalidValue(f"{where} must be one of {arguments}; got {_short(value)}")
    if origin in (Union, types.UnionType):
        # Null goes first: what is wrong with a value is told by the others
        for choice in sorted(arguments, key=lambda item: item is not types.NoneType):
            try:
                return _check(choice, value, where)
            except InvalidValue as error:
                problem = error
        if types.NoneType in arguments:
            raise InvalidValue(f"{problem} (or null)")
        raise problem
    if origin is tuple:
        if not isinstance(value, list) or len(value) > _LONGEST:
            raise InvalidValue(f"{where} must be a list; got {_short(value)}")
        if arguments[-1] is Ellipsis:
            return tuple(_check(arguments[0], item, where) for item in value)
        if len(value) != len(arguments):
            raise InvalidValue(f"{where} must have {len(arguments)} items; got {_short(value)}")
        return tuple(_check(part, item, where) for part, item in zip(arguments, value, strict=True))
    if origin is Mapping:
        if not isinstance(value, dict):
            raise InvalidValue(f"{where} must be an object; got {_short(value)}")
        return {key: _check(arguments[1], item, where) for key, item in value.items()}
    return _build(hint, value, where)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
