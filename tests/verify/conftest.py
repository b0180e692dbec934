"""`make verify`: its report, for every test that is marked, wherever it lives."""

from __future__ import annotations

import pytest

from tests.verify.report import Figures, Report


def pytest_configure(config: pytest.Config) -> None:
    if not config.pluginmanager.has_plugin("verify-report"):
        config.pluginmanager.register(Report(), "verify-report")


@pytest.fixture
def figures(request: pytest.FixtureRequest) -> Figures:
    return Figures(request.node.name, request.node.user_properties)
