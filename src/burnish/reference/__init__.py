"""Path-traced truth, by Mitsuba, and the series' approximations by a plain path tracer.

Nothing here borrows from the fast path that it judges.
"""

from burnish.reference.bsdf import layered_bsdf, layered_class
from burnish.reference.film import Estimate
from burnish.reference.series import series_image
from burnish.reference.truth import PathTracedTruth

__all__ = ["Estimate", "PathTracedTruth", "layered_bsdf", "layered_class", "series_image"]
