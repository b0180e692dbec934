"""Edits that outlive the process: kept in a file while they differ from what is saved."""

from __future__ import annotations

import os
from pathlib import Path

from burnish.core.errors import CannotWrite
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
        """Take up, or drop, what an earlier run left. Raises what loading edits raises."""
        text, self.left_behind = self.left_behind, None
        if accept and text is not None:
            self._session.load_text(text)

    def write(self, changed: bool) -> None:
        """Keep the edits, or no file where nothing is changed. Raises CannotWrite."""
        if self.path is None or self._session.revision == self._revision:
            return
        self._revision = self._session.revision
        try:
            if not changed:
                self.path.unlink(missing_ok=True)
                return
            self.path.parent.mkdir(parents=True, exist_ok=True)
            partial = self.path.with_suffix(".partial")
            partial.write_text(self._session.edits_text(), "utf-8")
            os.replace(partial, self.path)
        except OSError as error:
            raise CannotWrite(f"the edits could not be autosaved: {error}") from error


def _left_behind(path: Path | None) -> str | None:
    if path is None:
        return None
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return None
