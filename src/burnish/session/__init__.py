"""Sessions: edits, undo, selection, painting, frames and fitting; no sockets, no widgets."""

from burnish.session.brushes import Brush
from burnish.session.findings import Fit
from burnish.session.fitting import FitOptions, FitStep, fit, fit_steps
from burnish.session.painting import BrushOptions, PaintStroke
from burnish.session.session import ObjectInfo, Session
from burnish.session.unknowns import CurveOptions

__all__ = [
    "Brush",
    "BrushOptions",
    "CurveOptions",
    "Fit",
    "FitOptions",
    "FitStep",
    "ObjectInfo",
    "PaintStroke",
    "Session",
    "fit",
    "fit_steps",
]
