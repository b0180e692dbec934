"""Sessions: edits, undo, selection, frames and fitting; no sockets, no widgets."""

from burnish.session.findings import Fit
from burnish.session.fitting import FitOptions, FitStep, fit, fit_steps
from burnish.session.session import ObjectInfo, Session
from burnish.session.unknowns import CurveOptions

__all__ = [
    "CurveOptions",
    "Fit",
    "FitOptions",
    "FitStep",
    "ObjectInfo",
    "Session",
    "fit",
    "fit_steps",
]
