"""Edits that outlive the process: kept in a file while they differ from what is saved."""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path

from burnish.core.errors import BurnishError, CannotWrite, InvalidValue
from burnish.session import Session


class Autosave:
    """Writes the session's edits beside the user's own files, and finds what was left there."""

    def __init__(self, session: Session, path: Path | None) -> None:
        self._session = session
        self.path = path
        self._revision = session.revision
        self._saved = session.revision
        self.left_behind = _left_behind(path)
        """The text of an earlier run's edits, until it is taken up or dropped."""
        self._aside: Path | None = None

    @property
    def saved(self) -> bool:
        """Whether a file of the user's own has the present edits."""
        return self._session.revision == self._saved

    def text(self) -> str:
        """The edits as their file's text; counts as saved."""
        text = self._session.edits_text()
        self._saved = self._session.revision
        return text

    def recover(self, accept: bool) -> None:
        """Take up, or drop, what an earlier run left.

        Raises InvalidValue where it cannot be loaded; it stays on offer then, and in a file of
        its own. Raises CannotWrite.
        """
        if self.left_behind is None:
            return
        if accept:
            try:
                self._session.load_text(self.left_behind)
            except BurnishError as error:
                raise InvalidValue(f"{error}; the edits are kept in {self._set_aside()}") from error
        if self._aside is not None:
            self._aside.unlink(missing_ok=True)
        self.left_behind = self._aside = None

    def write(self, changed: bool) -> None:
        """Keep the edits, or no file where nothing is changed. Raises CannotWrite."""
        if self.path is None or self._session.revision == self._revision:
            return
        self._revision = self._session.revision
        self._set_aside()
        try:
            if not changed:
                self.path.unlink(missing_ok=True)
                return
            _write(self.path, self._session.edits_text())
        except OSError as error:
            raise CannotWrite(f"the edits could not be autosaved: {error}") from error

    def _set_aside(self) -> Path | None:
        """Where what is on offer is kept beside the autosave, which may be overwritten; None
        where nothing is on offer. Raises CannotWrite."""
        text = self.left_behind
        if self._aside is None and self.path is not None and text is not None:
            digest = sha256(text.encode()).hexdigest()[:8]
            place = self.path.with_name(f"{self.path.stem}-{digest}{self.path.suffix}")
            try:
                _write(place, text)
            except OSError as error:
                words = f"edits of an earlier run could not be kept: {error}"
                raise CannotWrite(words) from error
            self._aside = place
        return self._aside


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(text, "utf-8")
    os.replace(partial, path)


def _left_behind(path: Path | None) -> str | None:
    if path is None:
        return None
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return None
