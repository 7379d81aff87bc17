"""A street that is fitted as if it were long."""

import pytest


@pytest.fixture
def cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A street that counts as a long fiber, in stretches of some 35 m."""
    monkeypatch.setattr("solver.fit.longest.ONE_STRETCH", 50.0)
    monkeypatch.setattr("solver.fit.stretches.STRETCH", 35.0)
