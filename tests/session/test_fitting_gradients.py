"""Derivatives by parameters against central differences of the plain polynomial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.core.types import Float32, Float64, Value
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.lambert import Lambert
from burnish.materials.registry import MODELS
from burnish.runtime.freeze import freeze
from burnish.session import Session
from burnish.session.jacobian import PictureModel
from burnish.session.unknowns import CurveOptions, unknowns_of
from burnish.transport.basis import Basis, EditableObject, initial_state
from burnish.transport.block import Tile
from tests.runtime.worlds import Dense, glossy, matte, plain_image, random_world

WIDTH, HEIGHT = 8, 6
CLOSE = 1e-3


def object_of(name: str) -> EditableObject:
    """A matte object under a layer of a model, away from every limit of its parameters."""
    model = MODELS[name]()
    values: dict[str, Value] = {}
    rng = np.random.default_rng(len(name))
    for item in model.parameters:
        if item.kind == "colour":
            low, high = item.minimum, min(item.maximum, 3.0)
            red, green, blue = low + (high - low) * (0.2 + 0.4 * rng.random(3))
            values[item.name] = (float(red), float(green), float(blue))
        elif item.kind == "scalar":
            values[item.name] = float(item.validate(item.default))  # type: ignore[arg-type]
        else:
            values[item.name] = item.default
    layers = (
        Layer("diffuse", Lambert(), bins=1),
        Layer.starting_at("specular", model, values, bins=6),
    )
    diffuse = LayerState({"color": (0.3, 0.2, 0.1)})
    return EditableObject(
        "thing",
        Material(layers, MaterialState({"diffuse": diffuse, "specular": LayerState(values)})),
    )


def model_of(
    thing: EditableObject,
    series: tuple[int, ...] = (6, 1, 1),
    names: list[str] | None = None,
    targets: tuple[int, ...] = (0,),
    **state: object,
) -> tuple[PictureModel, list[tuple[Tile, Dense]]]:
    basis = Basis((thing, matte("floor"), glossy("lid", 4)), series, indirect_bins=2)
    source, tiles = random_world(basis, WIDTH, HEIGHT)
    now = initial_state(basis.objects)
    now["thing"] = replace(now["thing"], **state)  # type: ignore[arg-type]
    materials = {item.id: item.material for item in basis.objects}
    objects = [basis.objects[i].id for i in targets]
    unknowns = unknowns_of(materials, now, objects, names, CurveOptions(points=4))
    return PictureModel(freeze(source, targets, now), unknowns, now), tiles


def assert_exact(
    model: PictureModel, tiles: list[tuple[Tile, Dense]], x: Float64, width: float = 2e-3
) -> None:
    """Every column of the Jacobian is the difference quotient of the plain sum."""

    def image(x: Float64) -> Float64:
        return plain_image(model.frozen.basis, tiles, model.state(x), WIDTH, HEIGHT).reshape(-1, 3)

    np.testing.assert_allclose(model.image(x).T, image(x), rtol=1e-4)
    J = model.jacobian(x)
    for u in range(len(x)):
        step = np.zeros(len(x))
        step[u] = width * np.clip(abs(x[u]) / 0.3, 0.1, 1.0)
        expected = (image(x + step) - image(x - step)) / (2 * step[u])
        error = np.linalg.norm(J[:, :, u].T - expected)
        assert error <= CLOSE * np.linalg.norm(expected), (u, error)


def inside(model: PictureModel) -> Float64:
    """x of the start, moved off every bound."""
    x = model.read(model.start)
    high = np.where(np.isfinite(model.upper), model.upper, model.lower + 10)
    margin = np.minimum(0.05, 0.1 * (high - model.lower))
    return np.clip(x, model.lower + margin, high - margin)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_every_parameter_of_every_model(name: str) -> None:
    model, tiles = model_of(object_of(name))
    continuous = [p for p in MODELS[name]().parameters if p.kind != "choice"]
    assert len(model.unknowns) == 1 + len(continuous)
    # A coat's transmittance is a quadrature with breaks of its own: differences of one width
    width = 1e-3 if name == "plastic-base" else 2e-3
    assert_exact(model, tiles, inside(model), width)


def test_weights_curves_and_several_objects() -> None:
    names = ["diffuse.weight", "specular.curve", "specular.exponent", "thing.diffuse.color"]
    thing = replace(glossy("thing", 6))
    model, tiles = model_of(thing, names=names, targets=(0, 2))
    assert model.fitted_objects == ("thing", "lid")
    assert_exact(model, tiles, inside(model))


def test_coarse_coefficients_of_the_second_encounter() -> None:
    model, tiles = model_of(object_of("cook-torrance"), series=(6, 3, 1))
    assert_exact(model, tiles, inside(model))


def test_linked_layers() -> None:
    # With the link in force one colour dims the other layer in all channels
    model, tiles = model_of(
        glossy("thing", 6), names=["diffuse.color", "specular.color"], conserve=True
    )
    x = np.full(6, 0.9) + 0.01 * np.arange(6)
    assert_exact(model, tiles, x)


def test_a_few_pixels_are_those_of_the_picture() -> None:
    whole, _ = model_of(object_of("cook-torrance"))
    pixels = np.array([0, 3, 17, 18, 40])
    few = PictureModel(whole.frozen, whole.unknowns, whole.start, pixels)
    x = inside(whole)
    np.testing.assert_allclose(few.image(x), whole.image(x)[:, pixels], rtol=1e-5)
    np.testing.assert_allclose(few.jacobian(x), whole.jacobian(x)[:, pixels], rtol=1e-4, atol=1e-4)


def gradient_world() -> tuple[Session, list[tuple[Tile, Dense]], Basis]:
    basis = Basis((object_of("cook-torrance"), matte("floor")), (6, 1, 1), indirect_bins=2)
    source, tiles = random_world(basis, WIDTH, HEIGHT)
    return Session({"front": source}), tiles, basis


def test_the_session_s_gradient_of_one_s_own_loss() -> None:
    session, tiles, basis = gradient_world()
    weight = np.random.default_rng(3).random((HEIGHT, WIDTH, 3))

    def loss(image: Float32) -> tuple[float, Float32]:
        return float((weight * image**2).sum()), (2 * weight * image).astype(np.float32)

    value, slopes = session.gradient(loss, ["thing", "floor"])
    assert session.history == ([], 0)
    assert set(slopes) == {
        "thing.diffuse.color",
        "thing.specular.color",
        "thing.specular.roughness",
        "floor.diffuse.color",
    }

    def at(path: str, value: Value) -> float:
        session.set(path, value)
        image = plain_image(basis, tiles, session.state, WIDTH, HEIGHT)
        session.undo()
        return float((weight * image**2).sum())

    assert value == pytest.approx(at("thing.specular.roughness", 0.1), rel=1e-4)
    for path, slope in slopes.items():
        now = session.get(path)
        if isinstance(now, tuple):
            for h in range(3):
                sides = [
                    at(path, tuple(c + s * (i == h) for i, c in enumerate(now)))  # type: ignore[arg-type]
                    for s in (1e-4, -1e-4)
                ]
                assert slope[h] == pytest.approx((sides[0] - sides[1]) / 2e-4, rel=CLOSE)
        else:
            sides = [at(path, float(now) + s) for s in (1e-5, -1e-5)]
            assert float(slope) == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=CLOSE)


def test_the_gradient_s_loss_must_give_the_image_s_shape() -> None:
    session, _, _ = gradient_world()
    with pytest.raises(InvalidValue, match="shape"):
        session.gradient(lambda image: (0.0, image[:2]), ["floor"])
