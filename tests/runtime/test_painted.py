"""Painted frames: every row its own material, and their mean for the rest of the light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from burnish.core.types import Float64
from burnish.materials.layer import MaterialState
from burnish.materials.painting.canvas import Canvas
from burnish.materials.painting.stroke import Dab, Edit, Stroke
from burnish.materials.painting.varied import VariedObject, painted_values, painted_weights
from burnish.runtime.freeze import freeze
from burnish.runtime.painted import PaintedRenderer, PaintedRows
from burnish.transport.basis import Basis, State, initial_state
from burnish.transport.pack import TiledBlocks
from tests.runtime.worlds import Dense, Tile, basis_of, random_world, shaded

COLOURS = (
    Edit("set", "diffuse", "color", (0.9, 0.1, 0.4)),
    Edit("set", "specular", "color", (0.1, 0.8, 0.3)),
    Edit("scale", "specular", "weight", (2.5,)),
    Edit("scale", "diffuse", "weight", (0.2,)),
)
WIDTHS = (*COLOURS, Edit("add", "specular", "exponent", (0.4,), base=0.35))


def strokes(edits: Sequence[Edit], seed: int = 3) -> tuple[Stroke, ...]:
    rng = np.random.default_rng(seed)
    up = (0.6, 0.6, 0.6)
    return tuple(
        Stroke("b", (edit,), tuple(Dab(tuple(p), up, 0.6) for p in rng.random((2, 3))), 0.8, 0.6)
        for edit in edits
    )


class World:
    """Random transport of which the lid is painted."""

    def __init__(self, basis: Basis, edits: Sequence[Edit], conserve: bool = False) -> None:
        self.basis = basis
        self.source, self.tiles = random_world(basis)
        state = initial_state(basis.objects)
        self.state: State = {
            **state, "lid": replace(state["lid"], strokes=strokes(edits), conserve=conserve)
        }  # fmt: skip
        rows = self.source.rows
        own = np.flatnonzero((rows.object == 2) & ~rows.indirect)
        self.pixel = rows.pixel[own]
        self.canvas = Canvas(rows.position[own], rows.normal[own])
        self.area = rows.weight[own].astype(np.float64)
        self.varied = VariedObject(basis.objects[2].material, self.canvas, self.area)

    def rows(self) -> PaintedRows:
        return PaintedRows(self.pixel, self.varied.at(self.state["lid"]))

    def states(self) -> list[MaterialState]:
        """The material of every row, as a uniform one."""
        state = self.state["lid"]
        material = self.basis.objects[2].material
        result = []
        self.canvas.show(state.strokes)
        for r in range(len(self.pixel)):
            layers = dict(state.layers)
            for place, item in self.canvas.maps.items():
                layer = layers[place[0]]
                if place[1] == "weight":
                    h = float(painted_weights(item)[r])
                    layers[place[0]] = replace(layer, weight=layer.weight * h)
                    continue
                values = painted_values(material, state, place, item)[r]
                value = tuple(map(float, values)) if len(values) == 3 else float(values[0])
                layers[place[0]] = replace(layer, values={**layer.values, place[1]: value})
            result.append(MaterialState(layers, state.conserve))
        return result


def plain_painted(world: World) -> Float64:
    """The picture by the sums themselves, a uniform material for each painted row."""
    basis, state = world.basis, world.state
    states = world.states()
    uniform = [{**state, "lid": item} for item in states]
    share = world.area / world.area.sum()
    own = [v for v, (i, _) in enumerate(basis.variables) if i == 2]
    albedos = basis.albedos(state).copy()
    albedos[own] = sum(s * basis.albedos(u)[own] for s, u in zip(share, uniform, strict=True))
    tails = basis.monomials.evaluate(albedos)
    if basis.coarse:
        mine = np.array([i == 2 for i, _, _ in basis.coarse])
        coarse = basis.coarse_values(state).copy()
        coarse[mine] = sum(
            s * basis.coarse_values(u)[mine] for s, u in zip(share, uniform, strict=True)
        )
        tails = np.concatenate([np.ones((1, 3)), (coarse[:, None] * tails[None]).reshape(-1, 3)])
    image = np.zeros((world.source.height * world.source.width, 3))
    for tile, dense in world.tiles:
        add_tile(image, world, tile, dense, uniform, share, tails)
    return image.reshape(world.source.height, world.source.width, 3)


def add_tile(
    image: Float64, world: World, tile: Tile, dense: Dense, uniform: list[State],
    share: Float64, tails: Float64,
) -> None:  # fmt: skip
    basis, state, width = world.basis, world.state, world.source.width
    area = np.zeros((world.source.height, width, 3))
    area[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] = (
        tile.fixed.astype(np.float64) + tile.emission
    )
    image += area.reshape(-1, 3)
    for (index, indirect), (which, T) in dense.items():
        pixel, cosine = tile.rows.pixel[which], tile.rows.cos_theta_o[which].astype(float)
        c = np.tile(basis.column_coefficients(index, state, indirect), (len(which), 1, 1))
        if index == 2 and indirect:
            c[:] = sum(
                s * basis.column_coefficients(2, u, True)
                for s, u in zip(share, uniform, strict=True)
            )
        for k in range(len(which)):
            own = state
            if index == 2 and not indirect:
                own = uniform[int(np.searchsorted(world.pixel, pixel[k]))]
                c[k] = basis.column_coefficients(2, own)
            if indirect:
                continue
            s = basis.outgoing_factors(index, own, cosine[k : k + 1])
            for part, factor in zip(basis.slices(index), s, strict=True):
                if factor is not None:
                    c[k, part.start : part.stop] *= factor[0]
        light = np.einsum("rczh,rch,zh->rh", T.astype(np.float64), c, tails)
        np.add.at(image, pixel, light)


def frozen_view(source: TiledBlocks, state: State, *targets: int) -> PaintedRenderer:
    return PaintedRenderer(freeze(source, targets, state), frozenset({2}))


@pytest.mark.parametrize("series", [(6,), (6, 1, 1), (6, 3, 1)])
@pytest.mark.parametrize("conserve", [False, True])
def test_every_row_has_its_own_material(series: tuple[int, ...], conserve: bool) -> None:
    world = World(basis_of(series), COLOURS, conserve)
    expected = plain_painted(world)
    for targets in ((2,), (0, 2)):
        image = frozen_view(world.source, world.state, *targets).image(
            world.state, {2: world.rows()}
        )
        np.testing.assert_allclose(image, expected, rtol=3e-5)


@pytest.mark.parametrize("kind", ["plain", "with outgoing factors and a delta column"])
def test_a_parameter_is_rendered_through_the_basis(kind: str) -> None:
    lid = None if kind == "plain" else shaded("lid")
    world = World(basis_of((6, 1, 1), lid), WIDTHS)
    values = np.array([s.layers["specular"].values["exponent"] for s in world.states()])
    assert len(np.unique(values)) > 20
    image = frozen_view(world.source, world.state, 2).image(world.state, {2: world.rows()})
    # Between two of 257 nodes a lobe bends by less than 1 in 2,000
    np.testing.assert_allclose(image, plain_painted(world), rtol=5e-4)


def test_a_grown_stroke_renders_what_a_fresh_view_renders() -> None:
    world = World(basis_of((6, 1, 1), shaded("lid")), WIDTHS)
    all_strokes = world.state["lid"].strokes
    running = frozen_view(world.source, world.state, 2)
    pictures = []
    for count in (*range(1, 6), *range(5, 0, -1)):
        world.state = {
            **world.state,
            "lid": replace(world.state["lid"], strokes=all_strokes[:count]),
        }
        image = running.image(world.state, {2: world.rows()})
        fresh = World(world.basis, WIDTHS)
        fresh.state = world.state
        renderer = frozen_view(fresh.source, fresh.state, 2)
        assert image.tobytes() == renderer.image(fresh.state, {2: fresh.rows()}).tobytes()
        pictures.append(image)
    for before, after in zip(pictures[:5], reversed(pictures[5:]), strict=True):
        assert before.tobytes() == after.tobytes()


def test_a_slider_moves_what_is_not_painted() -> None:
    world = World(basis_of((6, 1, 1)), WIDTHS)
    running = frozen_view(world.source, world.state, 2)
    running.image(world.state, {2: world.rows()})
    lid = world.state["lid"]
    values = {**lid.layers["specular"].values, "exponent": 60.0, "color": (0.5, 0.5, 0.1)}
    layers = {**lid.layers, "specular": replace(lid.layers["specular"], values=values)}
    world.state = {**world.state, "lid": replace(lid, layers=layers)}
    image = running.image(world.state, {2: world.rows()})
    np.testing.assert_allclose(image, plain_painted(world), rtol=5e-4)


def test_a_row_that_the_view_does_not_know_takes_a_neighbours_paint() -> None:
    world = World(basis_of((6, 1, 1)), COLOURS)
    lost = 40
    kept = np.arange(len(world.pixel)) != lost
    assert world.pixel[lost + 1] == world.pixel[lost] + 1
    world.area[lost] = 0.0
    material = world.basis.objects[2].material
    whole = VariedObject(material, world.canvas, world.area)
    fewer = Canvas(world.canvas.positions[kept], world.canvas.normals[kept])
    missing = VariedObject(material, fewer, world.area[kept])
    state = world.state["lid"]
    images = [
        frozen_view(world.source, world.state, 2).image(
            world.state, {2: PaintedRows(pixel, varied.at(state))}
        )
        for pixel, varied in ((world.pixel, whole), (world.pixel[kept], missing))
    ]
    same = (images[0] == images[1]).all(axis=2).ravel()
    np.testing.assert_array_equal(np.flatnonzero(~same), [world.pixel[lost]])
    # Were it painted like its neighbour, it would be lit by the neighbour's material
    moved = world.canvas.positions.copy()
    moved[lost] = moved[lost + 1]
    normals = world.canvas.normals.copy()
    normals[lost] = normals[lost + 1]
    twin = VariedObject(material, Canvas(moved, normals), world.area)
    alike = frozen_view(world.source, world.state, 2).image(
        world.state, {2: PaintedRows(world.pixel, twin.at(state))}
    )
    np.testing.assert_allclose(images[1], alike, rtol=1e-6)
