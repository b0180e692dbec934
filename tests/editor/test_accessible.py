"""What a screen reader is told: every control has a name and a role, in every state of the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from burnish.app.server import EditorServer
from tests.editor import worlds

NAMED = {
    *("button", "checkbox", "combobox", "complementary", "dialog", "image", "img", "link"),
    *("listbox", "menuitem", "option", "radio", "region", "slider", "spinbutton", "switch"),
    *("tab", "textbox"),
}
"""Roles that say nothing without a name (WAI-ARIA 1.2, accessible name required)."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EditorServer]:
    folder: Path = tmp_path_factory.mktemp("accessible")
    with EditorServer(worlds.session(views=2, truth=True), autosave=folder / "edits.json") as it:
        yield it


def told(page: Any) -> list[tuple[str, str]]:
    """Role and name of all that a screen reader finds on the page, as Chromium computes them."""
    session = page.context.new_cdp_session(page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    return [
        (node["role"]["value"], node.get("name", {}).get("value", "").strip())
        for node in nodes
        if not node["ignored"]
    ]


def check(page: Any) -> list[tuple[str, str]]:
    found = told(page)
    nameless = [role for role, name in found if role in NAMED and not name]
    assert not nameless
    # A modal dialog hides everything behind it
    roles = Counter(role for role, _ in found)
    assert roles["main"] + roles["dialog"] == 1
    # Regions are found by their names
    regions = Counter(name for role, name in found if role in ("region", "complementary"))
    assert not [name for name, times in regions.items() if times > 1]
    doubled = page.evaluate(
        "() => { const ids = [...document.querySelectorAll('[id]')].map((e) => e.id);"
        " return ids.filter((id, i) => ids.indexOf(id) !== i); }"
    )
    assert not doubled
    return found


def test_every_control_has_a_name(page: Any) -> None:
    check(page)
    page.get_by_role("option", name="ball").click()
    page.get_by_role("region", name="Material of ball").wait_for()
    for tab in ("Material", "Mix", "Lights", "Paint"):
        page.get_by_role("tab", name=tab).click()
        page.get_by_role("tab", name=tab, selected=True).wait_for()
        found = check(page)
        assert any(role == "slider" for role, _ in found) or tab == "Lights"
    page.keyboard.press("?")
    page.get_by_role("dialog").wait_for()
    check(page)


def test_sliders_of_a_layer_are_told_apart(page: Any) -> None:
    page.get_by_role("option", name="ball").click()
    panel = page.get_by_role("region", name="Material of ball")
    panel.wait_for()
    layers = panel.get_by_role("region").all()
    assert len(layers) == 2
    for layer in layers:
        names = [slider.get_attribute("aria-label") for slider in layer.get_by_role("slider").all()]
        assert names
        assert len(names) == len(set(names))


def test_the_keyboard_reaches_every_control(page: Any) -> None:
    page.get_by_role("option", name="ball").click()
    page.get_by_role("region", name="Material of ball").wait_for()
    hidden = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, textarea, a[href]')]
          .filter((e) => e.offsetParent !== null && !e.disabled && e.tabIndex < 0
                         && e.closest('[role=radiogroup],[role=tablist],[role=listbox]') === null)
          .map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert not hidden
