"""What a reflectance model must answer so that it can be edited without re-tracing.

A model writes its BRDF as a sum of products (2006, eq. 7; 2008, eq. 30):

    ρ(ωi, ωo) = s(θo; v) · Σ_k a_k(v) q_k(ωi, ωo) · f(γ(ωi, ωo); v)

- `q_k`, the quotients, hold everything that is not edited; the path tracer leaves them
  inside the transport. `rank` of them lets effects that do not split into a product,
  such as masking that depends on roughness or a Fresnel term, be edited all the same.
  `q_0` is the reference quotient: it alone is used where coarse bins stand for the
  material (from the second encounter on).
- `f`, the profile, is the editable curve over the normalised coordinate t = γ / γ_max.
- `a_k`, the amplitudes, and `s`, a factor on the outgoing angle, are exact at run time.
- a delta lobe, where the model can be perfectly smooth, is one more column with its own
  outgoing factor.

Models are small frozen dataclasses: their fields are static choices (a distribution, a
number of terms); numbers that stay frozen after a bake are in `fixed` dictionaries.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from burnish.core.types import Float64, Value
from burnish.materials.maths import Maths
from burnish.materials.parameter import Parameter

Values = Mapping[str, Value]
Fixed = Mapping[str, Any]
"""Frozen numbers: floats in NumPy code, per-lane arrays inside a kernel."""


class Model(ABC):
    """A reflectance model in the sum-of-products form of this module."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    fixed_parameters: ClassVar[tuple[Parameter, ...]] = ()
    coordinate_name: ClassVar[str] = "none"
    """γ's symbol: "none", "theta_h", "theta_d", "theta_r", "gamma_r", ..."""
    coordinate_maximum: ClassVar[float] = 1.0
    """γ_max, in radians for angles; γ = γ_max · t."""
    can_be_delta: ClassVar[bool] = False
    lobe: ClassVar[Literal["cosine", "half"]] = "cosine"
    """How directions are best drawn: over the cosine, or as half vectors spread over t."""
    inverse: ClassVar[Literal["half", "axis", "none"]] = "half"
    """How the coordinate is inverted for integrals: by `half_angle`; as the named coordinate
    about another axis that it is ("theta_in", "theta_r", "theta_d"; see `coordinates`); or
    not, and then directions are sorted into bins."""
    quadrature_points: ClassVar[int] = 1024
    """How many values of t the integrals over a layer use."""
    anisotropic: ClassVar[bool] = False
    """Whether ρ changes when both directions turn about the normal together."""

    @property
    def rank(self) -> int:
        """How many quotients the model has; static."""
        return 1

    def freeze(self, values: Values) -> dict[str, float]:
        """The frozen numbers of a layer that starts at `values`; the form is exact there."""
        return {item.name: float(item.default) for item in self.fixed_parameters}  # type: ignore[arg-type]

    def half_angle(self, t: Float64, phi: Float64, fixed: Fixed) -> tuple[Float64, Float64]:
        """θh where the coordinate is t at the half vector's azimuth φ, and dωh / (dt dφ).

        Where `inverse` is "half" only; arrays broadcast. Inverts `coordinate`, whose t must depend
        on the half vector alone. This default is for θh itself.
        """
        theta = t * self.coordinate_maximum + 0.0 * phi
        return theta, np.sin(theta) * self.coordinate_maximum

    @abstractmethod
    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        """t = γ/γ_max in [0, 1] for unit directions in the local frame (z is the normal)."""

    @abstractmethod
    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        """[rank] scalars q_k, without the cosine; wi.z > 0 and wo.z > 0 is given."""

    @abstractmethod
    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        """a_k: float64 [rank, 3], linear RGB."""

    def amplitude_sizes(self) -> Float64 | None:
        """How large each a_k is over the parameters' ranges: float64 [rank].

        For models whose quotients are no energies, such as principal components; None for all
        others. What is stored is made small by what an error of it would be multiplied by.
        """
        return None

    @abstractmethod
    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        """f(t): float64 [len(t), 3 or 1], at rough settings. All zero when perfectly smooth."""

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        """s(θo): float64 [len(cos_theta_o), 3 or 1], or None for 1 everywhere."""
        return None

    def delta(self, values: Values, fixed: Fixed) -> Float64:
        """Weight of the delta column, float64 [3]; zero when the lobe is rough."""
        raise NotImplementedError

    def delta_outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64:
        """Factor on the delta column (Fresnel at θd = θo): float64 [len, 3 or 1]."""
        raise NotImplementedError

    @abstractmethod
    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        """The true BRDF, three channels, no cosine, from the paper's own formula.

        Never through `quotients` and `profile`: tests and the reference compare the two.
        `values` holds scalars, or 3-lists for colours, that may be per-lane arrays; the
        layer's fixed numbers are merged in.
        """
