"""The part of a session that is about lights: what is set on each, and what may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from burnish.core.colour import colour_from_hex
from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Value
from burnish.materials.lights import LightGroup, LightState, lights_in, resolve
from burnish.session.history import History
from burnish.session.pictures import ViewPictures
from burnish.transport.basis import State

STORED = (
    "a bake holds the light as it came from where the lights stood; open the scene itself, live or "
    "with --mode relight, to move or turn them"
)


class Lighting:
    """Mixed into `Session`, which has the history and the views."""

    _history: History
    _lights: tuple[LightGroup, ...]
    _pictures: Mapping[str, ViewPictures]

    @property
    def lights(self) -> tuple[LightGroup, ...]:
        """The lights, or groups of them, that can be mixed: "light:NAME.intensity" and so on."""
        return self._lights

    def light(self, name: str) -> LightState:
        """What is set on a light or group of lights. Raises UnknownName."""
        for group in self._lights:
            if group.name == name:
                return self._light(group)
        raise UnknownName("light", name, [group.name for group in self._lights])

    @property
    def lights_fixed(self) -> str:
        """Why no light can be moved, turned or replaced here, or ""."""
        if all(getattr(view.transport, "relights", False) for view in self._pictures.values()):
            return ""
        return STORED

    def _record(self, label: str, state: State) -> None:
        raise NotImplementedError

    def _light(self, group: LightGroup) -> LightState:
        return lights_in(self._history.state).get(group.key, group.initial)

    def _get_light(self, path: str) -> Value:
        light = resolve(self._lights, path)
        return self._light(light.group).get(light.parameter)

    def _set_light(self, path: str, value: object) -> None:
        light = resolve(self._lights, path)
        if isinstance(value, str) and value.startswith("#"):
            value = colour_from_hex(value)
        changed = self._light(light.group).set(light.parameter, value, light.group.key)
        self._check_lights({light.group.key: changed})
        label = f"Set {path} to {shown(changed.get(light.parameter))}"
        self._change_light(light.group, changed, label)

    def _reset_light(self, path: str, label: str) -> None:
        """Back to the scene's own: a light, or one of its parameters. Raises UnknownName."""
        for group in self._lights:
            if path == group.key:
                self._change_light(group, group.initial, label)
                return
        light = resolve(self._lights, path)
        group, name = light.group, light.parameter
        original = self._light(group).set(name, group.initial.get(name), path)
        self._change_light(group, original, label)

    def _change_light(self, group: LightGroup, light: LightState, label: str) -> None:
        """Lights that are as the scene has them are left out of the state."""
        state = {key: item for key, item in self._history.state.items() if key != group.key}
        self._record(label, state if light == group.initial else state | {group.key: light})

    def _check_lights(self, state: State) -> None:
        """Raises UnknownName for a light that the scene lacks, InvalidValue for one that
        stands where this session cannot show it."""
        known: Sequence[str] = [group.key for group in self._lights]
        for key, light in lights_in(state).items():
            if key not in known:
                raise UnknownName("light", key, known)
            group = self._lights[known.index(key)]
            moved = light.moved(group)
            if moved and self.lights_fixed:
                raise InvalidValue(f"{key}.{moved[0]} cannot change here: {self.lights_fixed}")


def shown(value: Value) -> str:
    """A value as the history names it."""
    if isinstance(value, tuple):
        return "(" + ", ".join(f"{item:.4g}" for item in value) + ")"
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:.4g}"
