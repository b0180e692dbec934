"""The lights: what a user sets on each, and the factor that it makes of them.

Light adds up. With everything else as it is, the picture is Σ_g m_g · image_g over the lights
(or named groups of them), and a mix m [g, rgb] is a linear factor of every one.

A light's state stands among those of the materials under "light:NAME", as its path does:

| parameter | values | |
|---|---|---|
| `intensity` | 0 to 1,000,000, linear | 2 is one stop more |
| `tint` | linear RGB, 0 to 1 | white leaves the light's own colour |
| `on` | true, false | a light that is off sends nothing |
| `solo` | true, false | while any light is solo, only such ones shine |

A single light has the parameters of its kind beside these (`materials.placement`): they say
where it stands and how it is turned, which is no factor: the light is traced anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import RGB, Float64, Value
from burnish.materials.layer import LayerState, MaterialState
from burnish.materials.parameter import Parameter
from burnish.materials.placement import EXPOSURE, TEMPLATES

PREFIX = "light:"

PARAMETERS = (
    Parameter(
        "intensity", 1.0, 0.0, 1e6, 0.0, 4.0, unit="×", description="scales what the light sends"
    ),
    Parameter("tint", (1.0, 1.0, 1.0), kind="colour", description="multiplies the light's colour"),
)
SWITCHES = ("on", "solo")

MOST_GROUPS = 4
"""Light groups that one bake may tell apart: its transport has that many times the tails."""

REST = "rest"
"""The group of the lights that no group was asked for."""

_WORDS = {"on": True, "true": True, "yes": True, "off": False, "false": False, "no": False}


@dataclass(frozen=True)
class Light:
    """A light of a scene: an emitter, or the emitters of one object; kind: Mitsuba's name.

    parameters: those of its kind, with the scene's values as defaults.
    """

    name: str
    kind: str = ""
    parameters: tuple[Parameter, ...] = ()


@dataclass(frozen=True)
class LightGroup:
    """Lights that are mixed as one. members: names of the scene's lights; parameters: those
    of the light where it is one alone."""

    name: str
    members: tuple[str, ...]
    parameters: tuple[Parameter, ...] = ()

    @property
    def key(self) -> str:
        """Where its state stands among the materials'."""
        return PREFIX + self.name

    @property
    def initial(self) -> LightState:
        """As the scene has it."""
        values = {item.name: item.default for item in self.parameters}
        return LightState(members=self.members, values=values)

    @property
    def names(self) -> tuple[str, ...]:
        """What its path may end with."""
        own = (item.name for item in self.parameters)
        return (*(item.name for item in PARAMETERS), *SWITCHES, *own)


@dataclass(frozen=True)
class LightState(MaterialState):
    """What a user has set on a light or a group of lights; it has no layers.

    values: of the parameters that its kind has (`materials.placement`), all of them, those
    that are as in the scene too.
    """

    layers: Mapping[str, LayerState] = field(default_factory=dict)
    members: tuple[str, ...] = ()
    intensity: float = 1.0
    tint: RGB = (1.0, 1.0, 1.0)
    on: bool = True
    solo: bool = False
    values: Mapping[str, Value] = field(default_factory=dict)

    def get(self, parameter: str) -> Value:
        """A parameter's value."""
        if parameter in self.values:
            return self.values[parameter]
        value: Value = getattr(self, parameter)
        return value

    @property
    def exposure(self) -> float:
        """Stops that an environment is brighter than in the scene, beside its intensity."""
        return float(self.values.get(EXPOSURE, 0.0))  # type: ignore[arg-type]

    def moved(self, group: LightGroup) -> tuple[str, ...]:
        """Which parameters of its placement are not as in the scene."""
        initial = group.initial.values
        return tuple(
            name
            for name, value in self.values.items()
            if name != EXPOSURE and value != initial.get(name)
        )

    def set(self, parameter: str, value: object, where: str) -> LightState:
        """The state with another value. Raises InvalidValue when it is out of range, UnknownName
        for a parameter that it lacks, MissingFile for a file that is not there."""
        accepted: Any
        if parameter in self.values:
            accepted = TEMPLATES[parameter].validate(value, f"{where}.")
            return replace(self, values={**self.values, parameter: accepted})
        if parameter in SWITCHES:
            accepted = _switch(value, f"{where}.{parameter}")
        else:
            known = {item.name: item for item in PARAMETERS}
            if parameter not in known:
                raise UnknownName("light parameter", parameter, [*known, *SWITCHES, *self.values])
            accepted = known[parameter].validate(value, f"{where}.")
        return replace(self, **{parameter: accepted})


@dataclass(frozen=True)
class LightAddress:
    """One parameter of one light."""

    group: LightGroup
    parameter: str


def resolve(groups: Sequence[LightGroup], path: str) -> LightAddress:
    """What "light:NAME.PARAMETER" names; names may hold dots. Raises UnknownName."""
    for group in groups:
        for name in group.names:
            if path == f"{group.key}.{name}":
                return LightAddress(group, name)
    known = [f"{group.key}.{name}" for group in groups for name in group.names]
    raise UnknownName("light parameter", path, known)


def lights_in(state: Mapping[str, MaterialState]) -> dict[str, LightState]:
    """The lights among the states, by key."""
    return {key: item for key, item in state.items() if isinstance(item, LightState)}


def without_lights(state: Mapping[str, MaterialState]) -> dict[str, MaterialState]:
    """The materials among the states."""
    return {key: item for key, item in state.items() if not isinstance(item, LightState)}


def mix(groups: Sequence[LightGroup], state: Mapping[str, MaterialState]) -> Float64:
    """The factor of each group: float64 [groups, 3], linear RGB; 1 where nothing is set."""
    lights = lights_in(state)
    solo = any(light.solo for light in lights.values())
    result = np.ones((len(groups), 3))
    for g, group in enumerate(groups):
        light = lights.get(group.key, group.initial)
        shines = light.on and (light.solo or not solo)
        sent = light.intensity * 2.0**light.exposure
        result[g] = np.array(light.tint) * sent if shines else 0.0
    return result


def placements(
    lights: Iterable[Light], state: Mapping[str, MaterialState]
) -> dict[str, dict[str, Value]]:
    """What of each light's placement is not as the scene has it, by light and parameter.

    lights: all of the scene's. Lights that stand as in the scene are left out.
    """
    known = {light.name: light for light in lights}
    result: dict[str, dict[str, Value]] = {}
    for light in lights_in(state).values():
        for name in light.members if light.values else ():
            parameters = known[name].parameters if name in known else ()
            own = {item.name: item.default for item in parameters}
            changed = {
                key: value
                for key, value in light.values.items()
                if key != EXPOSURE and own.get(key) != value
            }
            if changed:
                result[name] = changed
    return result


def standing(state: Mapping[str, MaterialState]) -> dict[str, dict[str, Value]]:
    """Where the lights of a state stand, by key; alike for states of the same transport.

    One on which nothing is set is left out, and need not stand elsewhere than one that is not.
    """
    return {
        key: {name: value for name, value in light.values.items() if name != EXPOSURE}
        for key, light in lights_in(state).items()
        if light.values
    }


def unmixed(
    groups: Iterable[LightGroup], state: Mapping[str, MaterialState]
) -> dict[str, MaterialState]:
    """The materials, and the lights that stand elsewhere, each sending what it does in the
    scene: what the pictures that are mixed are of."""
    result, lights = without_lights(state), lights_in(state)
    for group in groups:
        if group.key in lights:
            values = dict(lights[group.key].values)
            values |= {EXPOSURE: 0.0} if EXPOSURE in values else {}
            placed = replace(group.initial, values=values)
            if placed != group.initial:
                result[group.key] = placed
    return result


def factors(lights: Iterable[Light], state: Mapping[str, MaterialState]) -> dict[str, RGB]:
    """The factor of each light of a scene that is not as the scene has it.

    lights: all of the scene's. A state names those that something is set on, alone or in
    groups; the others are as the scene has them, or dark while one of those is solo.
    """
    groups = [
        LightGroup(key.removeprefix(PREFIX), s.members) for key, s in lights_in(state).items()
    ]
    named = {name for group in groups for name in group.members}
    rest = tuple(light.name for light in lights if light.name not in named)
    # No light has this name, so nothing is set on the group
    groups.append(LightGroup("", rest))
    result: dict[str, RGB] = {}
    for group, (r, g, b) in zip(groups, mix(groups, state).tolist(), strict=True):
        if (r, g, b) != (1.0, 1.0, 1.0):
            result |= dict.fromkeys(group.members, (r, g, b))
    return result


def each(lights: Iterable[Light]) -> tuple[LightGroup, ...]:
    """Every light a group of its own."""
    return tuple(LightGroup(light.name, (light.name,), light.parameters) for light in lights)


def grouped(lights: Sequence[Light], wanted: Sequence[str]) -> tuple[LightGroup, ...]:
    """The groups that a bake was asked for, and one of the lights that are in none.

    wanted: "each" alone, or for each group a light's name or "name=light+light". Raises
    UnknownName; InvalidValue for a light in two groups, two groups of one name, or more
    than MOST_GROUPS.
    """
    known = {light.name for light in lights}
    if tuple(wanted) == ("each",) and "each" not in known:
        groups = list(each(lights))
    else:
        groups = [_group(text, known) for text in wanted]
        own = {light.name: light.parameters for light in lights}
        taken = [name for group in groups for name in group.members]
        for names, what in (([g.name for g in groups], "group"), (taken, "light")):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InvalidValue(
                    f"light groups name the {what} {twice[0]!r} twice; once is enough"
                )
        rest = tuple(light.name for light in lights if light.name not in taken)
        if groups and rest:
            name = REST
            while name in {group.name for group in groups}:
                name += "_2"
            groups.append(LightGroup(name, rest))
        groups = [
            replace(group, parameters=own[group.members[0]]) if len(group.members) == 1 else group
            for group in groups
        ]
    if len(groups) > MOST_GROUPS:
        listing = ", ".join(group.name for group in groups)
        raise InvalidValue(
            f"a bake tells at most {MOST_GROUPS} light groups apart; got {len(groups)} "
            f"({listing}): put some together, like "
            f"key={groups[0].members[0]}+{groups[1].members[0]}, or bake without light groups "
            "and mix by pictures of each light"
        )
    return tuple(groups)


def _group(text: str, known: set[str]) -> LightGroup:
    name, equals, listed = text.partition("=")
    # A light's own name may hold the signs
    if text in known or not equals:
        name, members = text, [text]
    else:
        members = [item.strip() for item in listed.split("+")]
    for member in members:
        if member not in known:
            raise UnknownName("light", member, known)
    if not name.strip():
        raise InvalidValue(f"a light group is NAME=LIGHT+LIGHT or a light's name; got {text!r}")
    return LightGroup(name.strip(), tuple(dict.fromkeys(members)))


def _switch(value: object, field_name: str) -> bool:
    if isinstance(value, str) and value.lower() in _WORDS:
        return _WORDS[value.lower()]
    if isinstance(value, (bool, int, float)) and value in (0, 1):
        return bool(value)
    raise InvalidValue(f"{field_name} must be on or off; got {value!r}")
