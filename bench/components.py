"""How many principal components models need, for docs/components.md.

python -m bench.components
"""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float64
from burnish.materials.models.family import PrincipledFamily
from burnish.materials.pca.model import ComponentModel
from burnish.materials.pca.models import SIX, BlinnPhongComponents
from burnish.materials.pca.term import TermBasis, papers_sampling, term_basis

ERRORS = (0.1, 0.03, 0.01, 0.003, 0.001)
SETS = (
    ("roughness",),
    ("roughness", "metallic"),
    ("roughness", "metallic", "specular", "clearcoat"),
)
COUNTS = (2, 4, 6, 8, 10, 12)
GAMMAS = (3.0, 5.0, 10.0, 30.0, 100.0, 200.0, 300.0)
SAMPLES, MEMBERS = 512, 298
"""Even steps of δ and of γ, for the paper's measure."""


def main() -> None:
    """Print the tables of docs/components.md."""
    print("Mitsuba's principled\n")
    principled()
    print("\nThe 2010 paper's models, by the error asked for\n")
    by_error()
    print("\nIts figure 5 (a): RMS and relative RMS over the number of components\n")
    figure_5a()
    print("\nIts figure 5 (c): the relative RMS of Blinn-Phong's members\n")
    figure_5c()


def principled() -> None:
    """Component count against error, for sets of parameters."""
    _head("parameters", "members", *(f"{error:g}" for error in ERRORS), "worst member")
    for varied in SETS:
        family = PrincipledFamily(varied=varied, error=min(ERRORS))
        found, members = family.components, len(family.members())
        counts = (int(np.argmax(found.errors <= error)) + 1 for error in ERRORS)
        worst = found.worst[len(found.tables) - 1]
        _row(", ".join(varied), members, *counts, f"{worst:.1e}")


def by_error() -> None:
    """Component count against error, in the measure of `ComponentModel`."""
    _head("model", "γ", *(f"{error:g}" for error in ERRORS), "worst member")
    for kind in SIX:
        model = kind(error=min(ERRORS))
        basis = model.basis
        counts = (int(np.argmax(basis.errors <= error)) for error in ERRORS)
        _row(kind.name, _range(model), *counts, f"{basis.worst[len(basis.components)]:.1e}")


def figure_5a() -> None:
    """Errors in the paper's measure."""
    _head("model", "γ", *(str(count) for count in COUNTS))
    for kind in SIX:
        basis, members = _papers(kind())
        size = float(np.sqrt((members**2).mean()))
        cells = (f"{basis.errors[k] * size:.1e}, {basis.errors[k]:.1e}" for k in COUNTS)
        _row(kind.name, _range(kind()), *cells)


def figure_5c() -> None:
    """Each member's own error with six components."""
    model = BlinnPhongComponents()
    papers, _ = _papers(model)
    sampling = model.sampling()
    ours = term_basis(sampling.members(model.term), sampling.weight, 1e-9)
    even = papers_sampling(3.0, 300.0, np.sqrt(np.linspace(0.0, 1.0, SAMPLES)))
    _head("γ", *(f"{gamma:g}" for gamma in GAMMAS))
    for name, basis, x, weight in (
        ("even steps of δ and γ, as in the paper", papers, even.x, even.weight),
        ("members alike", ours, sampling.x, sampling.weight),
    ):
        cells = []
        for gamma in GAMMAS:
            p = model.term(np.float64(gamma), x)
            gap = basis.mean + basis.project(p)[1:7] @ basis.components[:6] - p
            cells.append(f"{np.sqrt((gap**2 @ weight) / (p**2 @ weight)):.1e}")
        _row(name, *cells)


def _papers(model: ComponentModel) -> tuple[TermBasis, Float64]:
    edited = model.edited
    x = np.sqrt(np.linspace(0.0, 1.0, SAMPLES))
    sampling = papers_sampling(edited.minimum, edited.maximum, x, MEMBERS)
    members = sampling.members(model.term)
    return term_basis(members, sampling.weight, 1e-9, alike=False), members


def _range(model: ComponentModel) -> str:
    return f"{model.edited.minimum:g} to {model.edited.maximum:g}"


def _head(*cells: str) -> None:
    _row(*cells)
    print("|---" * len(cells) + "|")


def _row(*cells: object) -> None:
    print("| " + " | ".join(str(cell) for cell in cells) + " |")


if __name__ == "__main__":
    main()
