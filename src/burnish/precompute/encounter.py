"""What only a vertex on an open material needs, left out where no lane has one.

A path meets few of them: one first encounter, at most one second. Lanes of a pixel stay
side by side, so a packet that is past them branches round the whole evaluation of models.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.precompute.symbolic import Slot, SymbolicMaterials, Terms


@dataclass
class Opened:
    """A first encounter, or one with a settled material of ours.

    columns, pdf: for light from the sampled emitter. wi, wi_pdf, delta, bounced: the next
    direction, its density (its probability where it is the delta lobe's), and its columns.
    Terms are without their weight maps.
    """

    columns: list[Terms]
    pdf: Any
    wi: Any
    wi_pdf: Any
    delta: Any
    bounced: list[Terms]


@dataclass
class Second:
    """A second encounter, with one layer. column, quotient, pdf: of light from the sampled
    emitter; wi, wi_pdf, wi_column, wi_quotient: of the next direction."""

    column: Any
    quotient: Any
    pdf: Any
    wi: Any
    wi_pdf: Any
    wi_column: Any
    wi_quotient: Any


def open_first(
    m: SymbolicMaterials,
    obj: Any,
    layouts: list[Slot],
    wi: Any,
    wo: Any,
    u1: Any,
    u2: Any,
    fine: Any,
    lit: Any,
    active: Any,
) -> Opened:
    """First encounters of the `active` lanes; those of `lit` have light from wi.

    fine: the lanes that use all bins.
    """
    no_maps = [None] * m.slots

    def met(
        obj: Any, layouts: list[Slot], wi: Any, wo: Any, u1: Any, u2: Any, *masks: Any
    ) -> tuple[Any, ...]:
        fine, lit, active = masks
        columns = m.columns(layouts, wi, wo, no_maps, fine, lit)
        pdf = m.pdf(obj, wi, wo)
        wi_next, wi_pdf, delta = m.sample(obj, wo, u1, u2)
        bounced = m.columns(layouts, wi_next, wo, no_maps, fine, active & ~delta)
        if m.any_delta:
            mirrored = m.delta_columns(obj, layouts, no_maps, delta & fine & active)
            bounced = [select_terms(delta, a, b) for a, b in zip(mirrored, bounced, strict=True)]
        return columns, pdf, wi_next, wi_pdf, delta, bounced

    def missed(*arguments: Any) -> tuple[Any, ...]:
        zero = _zero(arguments[-1])
        none = mi.UInt32(zero)

        def terms() -> list[Terms]:
            return [
                Terms(none, none, [zero] * rank, None, none, none if rank > 1 else None)
                for rank in m.ranks
            ]

        return terms(), zero, mi.Vector3f(zero), zero, zero != 0, terms()

    arguments = obj, layouts, wi, wo, u1, u2, fine, lit, active
    return Opened(*_where(active, arguments, met, missed, "first encounter"))


def meet_second(
    m: SymbolicMaterials,
    obj: Any,
    layouts: list[Slot],
    slot: Any,
    wi: Any,
    wo: Any,
    u1: Any,
    u2: Any,
    lit: Any,
    active: Any,
) -> Second:
    """Second encounters of the `active` lanes with the layer of a slot."""

    def met(
        obj: Any, layouts: list[Slot], slot: Any, wi: Any, wo: Any, u1: Any, u2: Any, *masks: Any
    ) -> tuple[Any, ...]:
        lit, active = masks
        column, quotient = m.coarse_column(obj, layouts, slot, wi, wo, lit)
        pdf = m.pdf_layer(obj, slot, wi, wo)
        wi_next, wi_pdf = m.sample_layer(obj, slot, wo, u1, u2)
        wi_column, wi_quotient = m.coarse_column(obj, layouts, slot, wi_next, wo, active)
        return column, quotient, pdf, wi_next, wi_pdf, wi_column, wi_quotient

    def missed(*arguments: Any) -> tuple[Any, ...]:
        zero = _zero(arguments[-1])
        none = mi.UInt32(zero)
        return none, zero, zero, mi.Vector3f(zero), zero, none, zero

    arguments = obj, layouts, slot, wi, wo, u1, u2, lit, active
    return Second(*_where(active, arguments, met, missed, "second encounter"))


def select_terms(condition: Any, a: Terms, b: Terms) -> Terms:
    """Terms a where the condition holds, else b; without what either has not."""

    def select(x: Any, y: Any) -> Any:
        return None if x is None or y is None else dr.select(condition, x, y)

    return Terms(
        select(a.column, b.column),
        select(a.stride, b.stride),
        [select(x, y) for x, y in zip(a.quotients, b.quotients, strict=True)],
        select(a.H, b.H),
        select(a.place, b.place),
        select(a.step, b.step),
    )


def _where(
    active: Any,
    arguments: tuple[Any, ...],
    met: Callable[..., tuple[Any, ...]],
    missed: Callable[..., tuple[Any, ...]],
    label: str,
) -> tuple[Any, ...]:
    result: tuple[Any, ...] = dr.if_stmt(arguments, active, met, missed, label=label)
    return result


def _zero(active: Any) -> Any:
    """A zero that is not a literal: a literal that both branches return is used outside the
    branch that defines it, and the kernel does not compile (Dr.Jit 1.5)."""
    return dr.select(active, mi.Float(1), 0)
