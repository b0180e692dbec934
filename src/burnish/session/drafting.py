"""The part of a session that is about frames while something is dragged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from burnish.core.types import Float32
from burnish.runtime.drafts import Choice
from burnish.session.history import History
from burnish.session.lightmix import LightMix
from burnish.session.pictures import ViewPictures


@dataclass(frozen=True)
class Draft:
    """A picture for the eye: float32 [height, width, 3], linear RGB.

    exact: whether it is the frame up to rounding; else ask again, and it comes closer. frame:
    whether it is the frame itself.
    """

    image: Float32
    exact: bool
    frame: bool


class Drafting:
    """Mixed into `Session`, which has the history and the views."""

    _history: History
    _pictures: Mapping[str, ViewPictures]
    light_mix: LightMix

    def draft(self, view: str | None = None) -> Draft:
        """The picture with the present materials, or one that comes close, whichever is faster.

        `frame` gives what is to be kept, saved or compared.
        """
        shown, state = self._view(view), self._history.state
        image, exact, frame = shown.draft(self._targets(), state)
        return Draft(self.light_mix.applied(shown.name, image, state), exact, frame)

    def drafts_help(self, view: str | None = None) -> bool:
        """Whether `draft` is faster than `frame` for anything that is selected."""
        return self._view(view).drafts_help

    def prepare_drafts(self, view: str | None = None) -> None:
        """In a pause: freeze the selection, measure whether drafts of it are faster, and begin
        them from the present picture. Nothing for live views, which change by themselves."""
        self._view(view).prepare_drafts(self._targets(), self._history.state)

    def draft_choices(self, view: str | None = None) -> tuple[Choice, ...]:
        """What was measured for the present selection."""
        return self._view(view).draft_choices

    def _view(self, view: str | None) -> ViewPictures:
        raise NotImplementedError

    def _targets(self) -> tuple[int, ...]:
        raise NotImplementedError
