"""Fits: what made the picture comes back, within bounds, whatever the picture lacks."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import burnish
from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float32, Float64
from burnish.materials.coefficients import albedo, conserved
from burnish.materials.curve import Curve
from burnish.materials.registry import MODELS
from burnish.runtime.tonemap import OPERATORS, ToneMap
from burnish.session import CurveOptions, FitOptions, Session, fit, fit_steps
from burnish.session.findings import structure_of
from burnish.session.leastsquares import box_minimum
from burnish.transport.basis import Basis
from tests.runtime.worlds import glossy, matte, random_world
from tests.session.recovery import recover, studio

SIDE = (24, 16)
BASIS = Basis((glossy("box", 12), matte("floor"), glossy("lid", 4)), (12, 1, 1), indirect_bins=2)
SOURCE, _ = random_world(BASIS, *SIDE)
EXACT = FitOptions(prior=1e-6)
"""For targets without noise: nothing pulls towards the start."""


def session_of() -> Session:
    return Session({"front": SOURCE}, name="test")


def wished(session: Session, **values: object) -> Float32:
    """The picture with other values of the box's parameters; the session is as before."""
    with session.gesture():
        for path, value in values.items():
            session.set("box." + path.replace("__", "."), value)
    image = session.frame()
    session.undo()
    return image


WISH = {"diffuse__color": (0.1, 0.3, 0.5), "specular__exponent": 120.0, "specular__color": 0.25}


def assert_is_the_wish(session: Session) -> None:
    assert session.get("box.diffuse.color") == pytest.approx((0.1, 0.3, 0.5), rel=5e-3)
    assert session.get("box.specular.color") == pytest.approx((0.25,) * 3, rel=5e-3)
    assert session.get("box.specular.exponent") == pytest.approx(120.0, rel=2e-2)


def test_a_material_comes_back_as_one_step_of_undo() -> None:
    session = session_of()
    target = wished(session, **WISH)
    before = session.frame()
    found = burnish.fit(session, target, objects=["box"], options=EXACT)
    assert_is_the_wish(session)
    assert found.reached
    assert not found.free
    assert not found.limited
    assert found.error < 1e-4 < found.error_before
    assert set(found.values) == {
        "box.diffuse.color", "box.specular.color", "box.specular.exponent"}  # fmt: skip
    assert session.selected == ("box",)
    assert session.history[1] == 1
    np.testing.assert_allclose(session.frame() - target, found.residual, atol=1e-3)
    session.undo()
    np.testing.assert_array_equal(session.frame(), before)


def test_steps_never_get_worse_and_can_be_left() -> None:
    session = session_of()
    target = wished(session, **WISH)
    steps = list(fit_steps(session, target, objects=["box"], options=replace(EXACT, starts=0)))
    errors = [step.error for step in steps]
    assert all(b <= a * (1 + 1e-6) for a, b in pairwise(errors))
    assert [step.result is not None for step in steps] == [False] * (len(steps) - 1) + [True]
    assert session.history[1] == 0
    with session.gesture():
        for step in fit_steps(session, target, objects=["box"]):
            session.restore(step.state)
            if step.number == 3:
                break
    assert session.history[1] == 1


def test_display_colours_through_every_tone_map() -> None:
    for operator in OPERATORS:
        session = session_of()
        tone = ToneMap(operator, exposure=-7.0)
        target = tone.display(wished(session, **WISH))
        fit(session, target, objects=["box"], options=replace(EXACT, tone=tone))
        assert_is_the_wish(session)


def test_what_is_masked_or_not_a_number_is_not_asked_for() -> None:
    session = session_of()
    target = wished(session, **WISH)
    mask = np.zeros(target.shape[:2], bool)
    mask[:, ::2] = True
    target[~mask] = 1e6
    target[3] = np.nan
    found = fit(session, target, mask=mask, objects=["box"], options=EXACT)
    assert_is_the_wish(session)
    assert not found.residual[~mask].any()
    assert not found.residual[3].any()


def test_weights_say_whom_to_please() -> None:
    session = session_of()
    dark = wished(session, diffuse__color=0.2)
    target = wished(session, diffuse__color=0.6)
    left = np.arange(SIDE[0]) < SIDE[0] // 2
    target[:, left] = dark[:, left]
    weight = np.where(left, 0.01, 1.0) * np.ones((SIDE[1], 1))
    options = replace(EXACT, robust=False)
    fit(session, target, mask=weight, parameters=["box.diffuse.color"], options=options)
    assert session.get("box.diffuse.color") == pytest.approx((0.6,) * 3, rel=1e-2)


def test_outliers_do_not_pull_far() -> None:
    rng = np.random.default_rng(5)
    errors = []
    for robust in (True, False):
        session = session_of()
        target = wished(session, **WISH)
        target *= 1 + 0.01 * rng.standard_normal(target.shape).astype(np.float32)
        target[rng.random(target.shape[:2]) < 0.02] *= 3
        fit(session, target, objects=["box"], options=replace(EXACT, robust=robust))
        wish = np.array([0.1, 0.3, 0.5])
        errors.append(np.abs(np.array(session.get("box.diffuse.color")) - wish).max())
    assert errors[0] < 0.1 * errors[1]


def test_several_objects_and_shared_names() -> None:
    session = session_of()
    session.select("box", "lid")
    start = session.state
    session.set("box.diffuse.color", (0.2, 0.3, 0.1))
    session.set("lid.diffuse.color", (0.5, 0.1, 0.4))
    target = session.frame()
    session.restore(start)
    found = fit(session, target, parameters=["diffuse.color"], options=EXACT)
    assert set(found.values) == {"box.diffuse.color", "lid.diffuse.color"}
    assert session.get("box.diffuse.color") == pytest.approx((0.2, 0.3, 0.1), rel=1e-3)
    assert session.get("lid.diffuse.color") == pytest.approx((0.5, 0.1, 0.4), rel=1e-3)


def test_what_the_picture_leaves_free_is_named_and_stays() -> None:
    session = session_of()
    target = wished(session, diffuse__weight=0.5)
    # Only the product of a weight and a colour shows
    names = ["box.diffuse.weight", "box.diffuse.color"]
    found = fit(session, target, parameters=names)
    assert set(found.free) >= {"box.diffuse.weight"}
    last = found.directions[-1]
    assert last.deviation > 10 * found.directions[-2].deviation
    assert set(last.parts) == set(found.free)
    product = np.array(session.get("box.diffuse.color")) * float(session.get("box.diffuse.weight"))  # type: ignore[arg-type]
    np.testing.assert_allclose(product, [0.25, 0.2, 0.1], rtol=1e-2)
    assert "left free" in found.report()


def albedo_of(session: Session, object_id: str) -> Float64:
    material = session.material(object_id)
    assert material is not None
    settled = conserved(material, session.state[object_id])
    return sum(
        (albedo(layer, settled.layers[layer.name]) for layer in material.layers), np.zeros(3)
    )


def test_a_wish_out_of_reach_gets_the_closest_physical_material() -> None:
    session = session_of()
    session.select("box")
    target = 1.6 * session.frame()
    found = fit(session, target, objects=["box"])
    assert not found.reached
    assert "box reflects all that it receives" in found.limited
    assert albedo_of(session, "box").max() <= 1 + 1e-6
    assert found.error < found.error_before
    assert found.heat_map().shape == target.shape
    assert 0 < found.heat_map().max() <= 1
    # Without the law the picture comes closer
    session.undo()
    free = fit(session, target, objects=["box"], options=FitOptions(physical=False))
    assert free.error < found.error
    assert albedo_of(session, "box").max() > 1


def test_a_limit_of_the_model_is_named() -> None:
    session = session_of()
    target = wished(session, diffuse__color=(1.0, 0.4, 0.2), diffuse__weight=1.3)
    options = FitOptions(physical=False)
    found = fit(session, target, parameters=["box.diffuse.color"], options=options)
    assert found.limited == ("box.diffuse.color red at its maximum",)
    assert session.get("box.diffuse.color")[0] == 1.0  # type: ignore[index]


HUMP = Curve(
    points=(0.0, 0.1, 0.3, 0.5, 1.0),
    values=((0.6, 0.5, 0.4), (0.9, 0.8, 0.3), (0.5, 0.3, 0.1), (0.05, 0.02, 0.02), (0.0, 0.0, 0.0)),
    mode="replace",
    interpolation="linear",
)


@pytest.mark.parametrize("monotone", [False, True])
def test_curves(monotone: bool) -> None:
    session = session_of()
    session.set_curve("box.specular", HUMP)
    target = session.frame()
    session.undo()
    curve = CurveOptions(points=12, monotone=monotone, smoothness=1e-4)
    options = replace(EXACT, curve=curve, physical=False)
    found = fit(session, target, parameters=["box.specular.curve"], options=options)
    shape = found.values["box.specular.curve"]
    assert isinstance(shape, Curve)
    values = np.array(shape.values)
    assert (values >= 0).all()
    falls = np.diff(values, axis=0)
    if monotone:
        assert (falls <= 1e-9).all()
        assert found.error < 0.05 < found.error_before
    else:
        assert falls.max() > 0.05
        assert found.error < 3e-3 < found.error_before


def test_smoothness_takes_the_bends_out() -> None:
    bends = []
    for smoothness in (1e-5, 1.0):
        session = session_of()
        session.set_curve("box.specular", HUMP)
        target = session.frame()
        session.undo()
        options = FitOptions(curve=CurveOptions(mode="gain", smoothness=smoothness))
        found = fit(session, target, parameters=["box.specular.curve"], options=options)
        shape = found.values["box.specular.curve"]
        assert isinstance(shape, Curve)
        bends.append(np.abs(np.diff(np.array(shape.values), n=2, axis=0)).max())
    assert bends[1] < 0.05 * bends[0]


def test_the_present_material_holds_back_as_asked() -> None:
    moved = []
    for prior in (1e-4, 0.3, 10.0):
        session = session_of()
        target = wished(session, diffuse__color=0.5)
        options = FitOptions(prior=prior, robust=False)
        fit(session, target, parameters=["box.diffuse.color"], options=options)
        moved.append(session.get("box.diffuse.color")[2] - 0.2)  # type: ignore[index, operator]
    assert moved[0] == pytest.approx(0.3, rel=1e-2)
    assert moved[0] > moved[1] > moved[2]
    assert 0 < moved[2] < 0.02


def test_the_minimum_in_a_box_meets_its_conditions() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        n = int(rng.integers(1, 12))
        A = rng.standard_normal((n + 2, n))
        H, g = A.T @ A + 1e-3 * np.eye(n), rng.standard_normal(n)
        low, high = -rng.random(n) * 0.5, rng.random(n) * 0.5
        low[rng.random(n) < 0.2] = 0.0
        d = box_minimum(H, g, low, high)
        slope = H @ d + g
        assert ((d >= low) & (d <= high)).all()
        # Karush, Kuhn and Tucker: no slope inside, and outwards at the walls
        np.testing.assert_allclose(slope[(d > low) & (d < high)], 0.0, atol=1e-9)
        assert (slope[(d == low) & (low < high)] >= -1e-9).all()
        assert (slope[(d == high) & (low < high)] <= 1e-9).all()


def test_noise_has_no_structure_and_a_wrong_colour_has() -> None:
    rng = np.random.default_rng(8)
    weight = np.ones((64, 64))
    noise = rng.standard_normal((64, 64, 3))
    # The mean over 12,288 numbers and their blocks leaves a few hundredths
    assert structure_of(noise, weight) < 0.1
    assert structure_of(noise + 0.5, weight) == pytest.approx(0.5, abs=0.05)


def test_bad_requests_say_what_is_wrong() -> None:
    session = session_of()
    target = session.frame()
    cases: list[tuple[type[Exception], str, dict[str, object]]] = [
        (UnknownName, "nothing", {"objects": ["nothing"]}),
        (InvalidValue, "at least one", {"objects": []}),
        (UnknownName, "box.specular.shine", {"parameters": ["box.specular.shine"]}),
        (UnknownName, "shine", {"parameters": ["specular.shine"], "objects": ["box"]}),
        (InvalidValue, "has no curve", {"parameters": ["box.diffuse.curve"]}),
        (InvalidValue, "two of the parameters",
         {"parameters": ["box.base_color", "box.diffuse.color"]}),
        (UnknownName, "view", {"view": "back"}),
        (InvalidValue, "mask must have", {"mask": np.ones((2, 2))}),
        (InvalidValue, "finite and >= 0", {"mask": np.full(target.shape[:2], -1.0)}),
        (InvalidValue, "asks for nothing", {"mask": np.zeros(target.shape[:2])}),
    ]  # fmt: skip
    for kind, message, arguments in cases:
        with pytest.raises(kind, match=message):
            fit(session, target, **arguments)  # type: ignore[arg-type]
    with pytest.raises(InvalidValue, match="target must have"):
        fit(session, target[:4])
    for name, value in (("prior", 0.0), ("starts", -1), ("steps", 0)):
        with pytest.raises(InvalidValue, match=name):
            FitOptions(**{name: value})  # type: ignore[arg-type]
    for name, value in (("points", 1), ("mode", "draw"), ("smoothness", -1.0)):
        with pytest.raises(InvalidValue, match=str(name)):
            CurveOptions(**{name: value})  # type: ignore[arg-type]
    assert session.history == ([], 0)


RECOVERED = ("blinn-phong", "cook-torrance", "ashikhmin-shirley-width", "ashikhmin-shirley-ratio")


def check_recoveries(name: str, folder: Path, seeds: range) -> dict[str, float]:
    place = studio(MODELS[name](), folder)
    found = [recover(place, seed) for seed in seeds]
    errors = np.concatenate([item.errors for item in found])
    # Half of the numbers at least are said to be determined, or the test would test nothing
    assert len(errors) >= 0.5 * sum(len(item.fit.numbers) for item in found)
    result = {
        "median parameter error": float(np.median(errors)),
        "worst image error ratio": max(item.ratio for item in found),
        "longest fit, s": max(item.fit.seconds for item in found),
    }
    assert result["median parameter error"] <= 0.05, result
    assert result["worst image error ratio"] <= 1.3, result
    return result


@pytest.mark.parametrize("name", RECOVERED[:2])
def test_random_materials_come_back_from_noisy_pictures(name: str, tmp_path: Path) -> None:
    check_recoveries(name, tmp_path, range(2))


@pytest.mark.verify
@pytest.mark.parametrize("name", RECOVERED)
def test_thirty_random_materials(name: str, tmp_path: Path) -> None:
    result = check_recoveries(name, tmp_path, range(30))
    assert result["longest fit, s"] <= 3.0, result


def test_colours_through_interreflection_alone(tmp_path: Path) -> None:
    scene = burnish.load("cornell-box", resolution=(32, 32))
    bundle = burnish.bake(
        scene, tmp_path / "box.burnish", editable=["left", "right"], series=(8, 1, 1, 1), spp=400
    )
    wish = {"left": (0.7, 0.3, 0.1), "right": (0.1, 0.25, 0.65)}
    session = burnish.edit(bundle)
    for name, colour in wish.items():
        session.set(f"{name}.diffuse.color", colour)
    target = burnish.path_trace(scene, session.materials, spp=400, bounces=4)
    session = burnish.edit(bundle)
    # Neither wall is seen: only what they throw on the others
    mask = session.object_map() < 0
    found = burnish.fit(session, target, mask=mask, objects=["left", "right"])
    assert set(found.determined) == {item.name for item in found.numbers}
    for name, colour in wish.items():
        np.testing.assert_allclose(session.get(f"{name}.diffuse.color"), colour, atol=0.05)


def test_ten_steps_a_second() -> None:
    session = session_of()
    target = wished(session, **WISH)
    began = time.process_time()
    steps = list(fit_steps(session, target, objects=["box"]))
    assert (time.process_time() - began) / len(steps) < 0.1
