"""Errors that a user can act on.

Each is a `BurnishError` and also the builtin that fits, so that callers who know
nothing of burnish still catch the right thing. A message names the field, the rule,
the value and the remedy; for files, the file and the place in it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class BurnishError(Exception):
    """Something that the user gave cannot be used; the message says what to do."""

    def __str__(self) -> str:
        return " ".join(str(part) for part in self.args)


class InvalidValue(BurnishError, ValueError):
    """A value lies outside its documented range or has the wrong type."""


class UnknownName(BurnishError, KeyError):
    """A name (object, layer, parameter, view, scene) that does not exist."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        candidates = sorted(known)
        near = difflib.get_close_matches(name, candidates, n=3, cutoff=0.4)
        shown = near or candidates[:12]
        hint = "nearest" if near else "known"
        listing = ", ".join(repr(item) for item in shown) or "none"
        super().__init__(f"no {kind} named {name!r}; {hint}: {listing}")


class MissingFile(BurnishError, FileNotFoundError):
    """A file or folder that should exist does not."""


class CannotWrite(BurnishError, OSError):
    """A picture or bundle cannot be written: no space, no permission, a taken name."""


class SceneError(BurnishError, ValueError):
    """A scene file is malformed or lacks what a render needs."""


class MeasurementError(BurnishError, ValueError):
    """Measured reflectance is truncated, has the wrong dimensions, or no valid cell."""


class BundleError(BurnishError, ValueError):
    """A bundle is truncated, foreign, or of a newer format."""


class TooLarge(BurnishError, MemoryError):
    """A bake would not fit; the message says what it needs and what to change."""


class DeviceError(BurnishError, RuntimeError):
    """No usable compute device or a missing system library."""


class MissingRayTracer(BurnishError, ImportError):
    """An operation needs Mitsuba, which cannot be imported here."""
