"""Painting from a page: strokes that grow message by message, and the brushes that there are."""

from __future__ import annotations

from contextlib import AbstractContextManager

from burnish.app import messages as m
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.pages import Pages
from burnish.core.errors import BurnishError, InvalidValue
from burnish.session import Session
from burnish.session.brushes import NAMES, Brush
from burnish.session.painting import PaintStroke


class Painting:
    """The strokes that are being drawn. Used from the engine's thread alone."""

    def __init__(self, session: Session, pages: Pages) -> None:
        self._session, self._pages = session, pages
        self._drawn: tuple[Mailbox, AbstractContextManager[PaintStroke], PaintStroke] | None = None
        self._key: object = None

    def carry_out(self, box: Mailbox, item: m.ClientMessage) -> bool:
        """Do what a message about paint asks; False for others. Raises BurnishError."""
        match item:
            case m.PaintBegin(view=view, settings=settings, every=every, straight=straight):
                self._begin(box, view, settings, every, straight)
            case m.PaintTo(points=points):
                self._draw(box, points)
            case m.PaintEnd():
                self._end(box)
            case m.PaintWhole(settings=settings):
                options = self._options(settings)
                self._session.paint_whole(settings.brush, self._session.selected, **options)
            case _:
                return False
        return True

    def farewell(self, box: Mailbox) -> None:
        """A page has gone, and its stroke ends where it is."""
        self._end(box)

    def welcome(self) -> None:
        """A page has come that knows no brushes."""
        self._key = None

    def publish(self) -> None:
        """The selected object's brushes, where they have changed."""
        session = self._session
        selected = session.selected[0] if session.selected else ""
        painted = tuple(name for name, state in session.state.items() if state.strokes)
        key = selected, painted, session.state[selected] if selected else None
        if key == self._key:
            return
        self._key = key
        items = tuple(map(_described, session.brushes(selected).values())) if selected else ()
        if not items:
            items = tuple(m.BrushData(name, "", "", (), False, 0, 0, 0, "") for name in NAMES)
        self._pages.to_all(m.Brushes(selected, items, painted))

    def _begin(
        self, box: Mailbox, view: str, settings: m.BrushSettings, every: bool, straight: bool
    ) -> None:
        if self._drawn is not None:
            if self._drawn[0] is not box:
                raise InvalidValue("another page is painting; wait until its stroke ends")
            self._end(box)
        self._pages.index(view)
        context = self._session.stroke(
            settings.brush,
            objects="all" if every else None,
            view=view,
            straight=straight,
            **self._options(settings),
        )
        self._drawn = box, context, context.__enter__()

    def _draw(self, box: Mailbox, points: tuple[m.PenPoint, ...]) -> None:
        if self._drawn is None or self._drawn[0] is not box:
            # The stroke was refused; what the pen still sends of it goes nowhere
            return
        try:
            self._drawn[2].extend(points)
        except BurnishError:
            self._end(box)
            raise

    def _end(self, box: Mailbox) -> None:
        if self._drawn is not None and self._drawn[0] is box:
            _, context, _ = self._drawn
            self._drawn = None
            context.__exit__(None, None, None)

    @staticmethod
    def _options(settings: m.BrushSettings) -> dict[str, object]:
        takes_colour = settings.brush.endswith("color")
        return {
            "size": settings.size,
            "strength": settings.strength,
            "falloff": settings.falloff,
            "color": settings.color if takes_colour else None,
            "amount": settings.amount,
            "layer": settings.layer or None,
            "source": settings.source,
        }


def _described(brush: Brush) -> m.BrushData:
    low, high = brush.limits or (0.0, 0.0)
    return m.BrushData(
        name=brush.name,
        label=brush.label,
        reason=brush.reason,
        layers=brush.layers,
        colour=brush.colour,
        amount=brush.amount or 0.0,
        minimum=low,
        maximum=high,
        meaning=brush.meaning,
    )
