"""From a layer's state to the numbers that multiply the stored transport.

Everything here is deterministic NumPy; what does not depend on the state is cached per
layer (see `quadrature`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.quadrature import EnergyTable, energy_table
from burnish.materials.two_curves import TwoCurves


def coefficients(layer: Layer, state: LayerState) -> Float64:
    """The coefficient of every column of a layer: float64 [layer.columns, 3], linear RGB.

    c_kj = a_k · (mean of f over bin j, weighted by the energy of q_k inside the bin), so that
    narrow lobes keep their energy however wide the bins are; k-major, the delta column last.
    (2008, eq. 30: f = Σ_j c_j b_j.) Of two curves they are the outer products of `sides`.
    """
    if isinstance(layer.model, TwoCurves):
        first, second = sides(layer, state)
        return np.asarray((first[:, :, None] * second[:, None]).reshape(-1, 3))
    result = np.zeros((layer.columns, 3))
    if not state.enabled:
        return result
    model, values = layer.model, state.values
    averages = _bin_averages(layer, state)
    amplitudes = model.amplitudes(values, layer.fixed)
    result[: model.rank * layer.bins] = (amplitudes[:, None, :] * averages).reshape(-1, 3)
    if layer.delta:
        result[-1] = model.delta(values, layer.fixed)
    return np.asarray(result * state.weight)


def sides(layer: Layer, state: LayerState) -> tuple[Float64, Float64]:
    """The coefficients of each curve of a layer with two: A float64 [k, j, 3] and B [k, l, 3].

    c_kjl = A_kj B_kl (2006, eq. 23); the amplitudes and the weight are in A.
    """
    model = layer.model
    assert isinstance(model, TwoCurves)
    if not state.enabled:
        return np.zeros((model.rank, model.bins, 3)), np.zeros((model.rank, model.bins2, 3))
    table = energy_table(layer)
    assert table.sides is not None
    found = []
    for side, edited in zip(table.sides, (edited_profile, edited_second_profile), strict=True):
        profile = edited(layer, state, side.t.ravel())
        profile = np.broadcast_to(profile, (side.t.size, 3)).reshape(*side.t.shape, 3)
        found.append(np.einsum("kjs,jsh->kjh", side.share, profile))
    amplitudes = model.amplitudes(state.values, layer.fixed)[:, None, :] * state.weight
    return amplitudes * found[0], found[1]


def outgoing(layer: Layer, state: LayerState, cos_theta_o: Float64, delta: bool) -> Float64 | None:
    """The exact factor s(θo) of a layer's bins, or of its delta column.

    cos_theta_o: float64 [n], 0 to 1. Gives float64 [n, 3 or 1], or None for 1 everywhere. A
    freehand `outgoing_curve` of the state is included.
    """
    cosine = np.clip(cos_theta_o, 0.0, 1.0)
    factor: Float64 | None
    if delta:
        factor = layer.model.delta_outgoing(cosine, state.values, layer.fixed)
    else:
        factor = layer.model.outgoing(cosine, state.values, layer.fixed)
    if state.outgoing_curve is None:
        return factor
    own = np.ones((len(cosine), 1)) if factor is None else factor
    return state.outgoing_curve.apply(np.arccos(cosine) * (2 / np.pi), own)


def albedo(layer: Layer, state: LayerState) -> Float64:
    """Equivalent albedo d of a layer: float64 [3] (2008, eq. 36–37), s(θo) included."""
    table = energy_table(layer)
    per_bin = _albedo_of_bins(layer, state, table)
    return np.asarray(per_bin.sum(axis=0) + _albedo_of_delta(layer, state, table))


def directional_albedo(layer: Layer, state: LayerState) -> tuple[Float64, Float64]:
    """Share of a beam from θo that a layer reflects: cosθo float64 [o] and float64 [o, 3]."""
    table = energy_table(layer)
    c = coefficients(layer, state)
    rank, bins = layer.model.rank, layer.bins
    fine = c[: rank * bins].reshape(rank, bins, 3)
    result = np.einsum("okj,kjh->oh", table.per_bin, fine)
    factor = outgoing(layer, state, table.cos_theta_o, delta=False)
    if factor is not None:
        result = result * factor
    if layer.delta:
        result = result + c[-1] * _delta_factor(layer, state, table)
    return table.cos_theta_o, result


def coarse_coefficients(layer: Layer, state: LayerState, count: int) -> Float64:
    """ĉ_w, which let q_0 alone stand for the layer: float64 [count, 3].

    The true energy of coarse bin w over the energy of q_0 · b_w; fine bin j belongs to
    coarse bin j · count // bins. A delta lobe's energy goes to the first. Hence
    Σ_w ĉ_w e_w / π is the albedo, whatever `count` is (DESIGN, section 2).
    """
    table = energy_table(layer)
    which = _coarse_bins(layer, count)
    true = np.zeros((count, 3))
    np.add.at(true, which, _albedo_of_bins(layer, state, table))
    true[0] += _albedo_of_delta(layer, state, table)
    reference = coarse_energies(layer, count)[:, None] / np.pi
    return np.divide(true, reference, out=np.zeros_like(true), where=reference > 0)


def coarse_energies(layer: Layer, count: int) -> Float64:
    """e_w = ∫∫ q_0 b_w cosθi cosθo dωi dωo: float64 [count]."""
    result = np.zeros(count)
    per_bin = energy_table(layer).mean_density[0].sum(axis=1) * np.pi
    np.add.at(result, _coarse_bins(layer, count), per_bin)
    return result


def energies(layer: Layer) -> tuple[Float64, Float64, Float64]:
    """Directional energies ∫ q_k b_j cosθi dωi of a layer.

    Gives cosθo float64 [o], the weights 2 cosθo dcosθo float64 [o] (they add to 1) and
    float64 [o, k, j]. π times the weighted mean over o is e_kj (2008, appendix B).
    """
    table = energy_table(layer)
    return table.cos_theta_o, table.weight, table.per_bin


def conserved(material: Material, state: MaterialState) -> MaterialState:
    """The state as it is rendered: links filled in and, if asked, energy conserved.

    With `conserve` set, all weights share one factor that keeps the sum of the layers'
    albedos at 1 or below in every channel: raising one layer takes from the others (2006,
    footnote 2).
    """
    state = material.linked(state)
    if not state.conserve:
        return state
    total = sum(albedo(layer, state.layers[layer.name]) for layer in material.layers)
    factor = 1.0 / max(1.0, float(np.max(total)))
    layers = {
        name: replace(layer, weight=layer.weight * factor) for name, layer in state.layers.items()
    }
    return replace(state, layers=layers)


def edited_profile(layer: Layer, state: LayerState, t: Float64) -> Float64:
    """f(t) with a freehand curve on it: float64 [len(t), 3 or 1]."""
    profile = layer.model.profile(t, state.values, layer.fixed)
    return profile if state.curve is None else state.curve.apply(t, profile)


def edited_second_profile(layer: Layer, state: LayerState, t: Float64) -> Float64:
    """The second curve of a model with two, with a freehand curve on it: [len(t), 3 or 1]."""
    model = layer.model
    assert isinstance(model, TwoCurves)
    profile = model.second_profile(t, state.values, layer.fixed)
    return profile if state.second_curve is None else state.second_curve.apply(t, profile)


def _bin_averages(layer: Layer, state: LayerState) -> Float64:
    """Energy-weighted means of f over the bins: float64 [k, j, 3 or 1]."""
    table = energy_table(layer)
    profile = edited_profile(layer, state, table.t.ravel()).reshape(*table.t.shape, -1)
    weight = table.mean_density
    total = weight.sum(axis=2, keepdims=True)
    # A bin that no energy reaches still shows its curve
    flat = np.full_like(weight, 1 / weight.shape[2])
    share = np.divide(weight, total, out=flat, where=total > 0)
    return np.asarray(np.einsum("kjs,jsh->kjh", share, profile))


def _albedo_of_bins(layer: Layer, state: LayerState, table: EnergyTable) -> Float64:
    """What each bin adds to the albedo: float64 [j, 3]."""
    rank, bins = layer.model.rank, layer.bins
    fine = coefficients(layer, state)[: rank * bins].reshape(rank, bins, 3)
    factor = outgoing(layer, state, table.cos_theta_o, delta=False)
    weight = table.weight[:, None] * (1.0 if factor is None else factor)
    weight = np.broadcast_to(weight, (len(table.weight), 3))
    energy = np.tensordot(weight, table.per_bin, axes=(0, 0))
    return np.asarray(np.einsum("hkj,kjh->jh", energy, fine))


def _albedo_of_delta(layer: Layer, state: LayerState, table: EnergyTable) -> Float64:
    if not layer.delta:
        return np.zeros(3)
    factor = table.weight @ _delta_factor(layer, state, table)
    return np.asarray(coefficients(layer, state)[-1] * factor)


def _delta_factor(layer: Layer, state: LayerState, table: EnergyTable) -> Float64:
    factor = outgoing(layer, state, table.cos_theta_o, delta=True)
    return np.ones((len(table.weight), 1)) if factor is None else factor


def _coarse_bins(layer: Layer, count: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    if not 1 <= count <= layer.bins:
        raise InvalidValue(
            f"layer {layer.name}: coarse bins must lie in [1, {layer.bins}]; got {count}"
        )
    return np.arange(layer.bins) * count // layer.bins
