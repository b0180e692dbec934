"""The lights of the session in the words of the messages."""

from __future__ import annotations

from burnish.app import messages as m
from burnish.app.server import describe
from burnish.materials.lights import PARAMETERS, PREFIX, lights_in
from burnish.materials.placement import EXPOSURE, TEMPLATES
from burnish.session import Session


def lights(session: Session, view: str) -> m.Lights:
    """What can be mixed, what is set, and what is not exact about it in a view."""
    changed = lights_in(session.state)
    maximum = next(item.maximum for item in PARAMETERS if item.name == "intensity")
    items = []
    for group in session.lights:
        light = session.light(group.name)
        items.append(
            m.LightData(
                path=group.key,
                name=group.name,
                members=group.members,
                intensity=light.intensity,
                tint=light.tint,
                on=light.on,
                solo=light.solo,
                parameters=tuple(
                    describe.parameter(item, item.default)
                    for item in group.parameters
                    if item.name == EXPOSURE or not session.lights_fixed
                ),
                values=dict(light.values),
                changed=group.key in changed,
            )
        )
    return m.Lights(
        items=tuple(items),
        maximum=maximum,
        text=session.light_mix.notice(view, session.state),
        fixed=session.lights_fixed,
    )


def moves_a_light(path: str) -> bool:
    """Whether a value at this path is of a light's placement, which is traced anew."""
    name = path.rpartition(".")[2]
    return path.startswith(PREFIX) and name in TEMPLATES and name != EXPOSURE
