"""Freezing and frames of a bundle, each beside what memory bandwidth alone would take.

`python -m bench.editing BUNDLE OBJECT [--repeats N]` prints them as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import statistics
from itertools import count
from pathlib import Path
from typing import Any

import burnish
from bench.timing import forget, interleaved, reader, seconds
from burnish.core.types import Value
from burnish.materials.parameter import Parameter
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.session import Session
from burnish.transport.basis import State
from burnish.transport.contraction import lit_columns
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart
from burnish.transport.stack import Stack

STEPS = 32


def measure(path: Path, object_id: str, repeats: int) -> dict[str, Any]:
    """Freeze one object and edit it. Milliseconds; "× bandwidth" over reading as many bytes.

    A freeze is measured until its first frame could be drawn, with no column contraction kept
    from earlier ones; a switch is from another object that has just been edited, first frame
    included.
    """
    bundle = burnish.open_bundle(path)
    source = next(iter(bundle.views.values()))
    index = (bundle.basis.index(object_id),)
    session = burnish.edit(bundle)
    turn_up_gloss(session, object_id)
    state = dict(session.state)

    # From memory, beside reading the blocks and what is made of them
    frozen = freeze(source, index, state)
    stacks = source.stacks()
    stored = sum(stack.nbytes for stack in stacks)
    read = sum(freeze_bytes(stack, frozen, state) for stack in stacks)
    made = sum(made_bytes(part) for part in frozen.parts)

    def frozen_anew() -> None:
        for stack in stacks:
            stack.kept.clear()
        Renderer(freeze(source, index, state))

    freezing = interleaved(
        {"freeze": frozen_anew, "read": reader(read + made)}, max(3, repeats // 4)
    )

    # With nothing read, nor in the system's cache
    def thaw() -> None:
        view = next(iter(burnish.open_bundle(path).views.values()))
        Renderer(freeze(view, index, state))

    cold = []
    for _ in range(3):
        forget(path)
        cold.append(seconds(thaw))

    # Frames, one parameter moving at each
    session.select(object_id)
    name, parameter = moving_parameter(session, object_id)
    turn = count()

    def frame() -> None:
        session.set(name, place(parameter, (next(turn) % STEPS + 0.5) / STEPS))
        session.frame()

    sizes = []
    for _ in range(STEPS):
        frame()
        sizes.append(frame_bytes(frozen, session))
    size = sum(sizes) // len(sizes)
    frames = interleaved({"frame": frame, "read": reader(size)}, repeats)
    return {
        "object": object_id,
        "edited": name,
        "pixels": source.width * source.height,
        "blocks_bytes": stored,
        "freeze_bytes": read + made,
        "frozen_bytes": made,
        "frame_bytes": size,
        "freeze_ms": 1e3 * freezing["freeze"],
        "freeze_bandwidth_ratio": freezing["freeze"] / freezing["read"],
        "switch_ms": 1e3 * switching(session, object_id),
        "cold_ms": 1e3 * sorted(cold)[1],
        "frame_ms": 1e3 * frames["frame"],
        "frame_bandwidth_ratio": frames["frame"] / frames["read"],
        "gb_s": size / frames["read"] / 1e9,
    }


def switching(session: Session, object_id: str) -> float:
    """Seconds until an object shows its first frame, after another one was edited: median."""
    other = next(info.id for info in session.objects if info.editable and info.id != object_id)
    name, parameter = moving_parameter(session, other)
    times = []
    for turn in range(9):
        session.set(name, place(parameter, (turn % STEPS + 0.5) / STEPS))
        session.frame()

        def switch() -> None:
            session.select(object_id)
            session.frame()

        times.append(seconds(switch))
    return statistics.median(times)


def turn_up_gloss(session: Session, object_id: str) -> None:
    """Give every layer of an object weight, so that all of its columns count."""
    for info in session.objects:
        for layer in info.layers if info.id == object_id else ():
            if session.state[object_id].layers[layer.name].weight == 0:
                session.set_weight(f"{object_id}.{layer.name}", 0.3)


def moving_parameter(session: Session, object_id: str) -> tuple[str, Parameter]:
    """The path of an object's number whose edits change most: its lobe's sharpness."""
    material = session.material(object_id)
    assert material is not None
    found = [
        (f"{object_id}.{layer.name}.{parameter.name}", parameter)
        for layer in material.layers
        for parameter in material.parameters(layer.name)
    ]
    for wanted in ("roughness", "exponent", "color"):
        for name, parameter in found:
            if parameter.name == wanted:
                return name, parameter
    return found[0]


def place(parameter: Parameter, t: float) -> Value:
    """A value at t in [0, 1] of a parameter's range."""
    if parameter.kind == "colour":
        return (0.2 + 0.6 * t, 0.4, 0.4)
    low, high = max(parameter.minimum, 0.02), min(parameter.maximum, 1e4)
    return low + (high - low) * t


def made_bytes(part: FrozenPart | FoldedPart) -> int:
    """What a freeze writes."""
    if isinstance(part, FoldedPart):
        return 0 if part.tails is None else part.tails.nbytes
    return part.nbytes


def freeze_bytes(stack: Stack, frozen: Frozen, state: State) -> int:
    """What a freeze must read of a stack at least: of a target's its tails, of another's its lit
    columns and all else; nothing of a layer without weight."""
    if stack.object in frozen.targets:
        return stack.S.nbytes
    lit = lit_bytes(stack, frozen, state)
    return lit + stack.S.nbytes + stack.expansion.nbytes if lit else 0


def lit_bytes(stack: Stack, frozen: Frozen, state: State) -> int:
    """Bytes of the columns of a stack's core that add light to a picture."""
    span = slice(stack.start, stack.start + stack.columns)
    weights = frozen.basis.column_coefficients(stack.object, state, stack.indirect)[span]
    spans = [lit_columns(weights[:, h] * stack.scale[h]) for h in range(3)]
    columns = sum(lit.stop - lit.start for lit in spans)
    size: int = stack.core[0].nbytes * columns
    return size // stack.columns


def frame_bytes(frozen: Frozen, session: Session) -> int:
    """What a frame must touch at least: the lit columns of the targets' blocks, or their F; V
    of all other rows; and the picture, written."""
    size = 3 * 4 * frozen.width * frozen.height
    for part in frozen.parts:
        if not isinstance(part, FoldedPart):
            size += part.nbytes
            continue
        stack = part.stack
        size += part.nbytes - stack.core.nbytes + lit_bytes(stack, frozen, session.state)
    return size


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("object")
    parser.add_argument("--repeats", type=int, default=40)
    options = parser.parse_args()
    print(json.dumps(measure(options.bundle, options.object, options.repeats)))


if __name__ == "__main__":
    main()
