"""Shared fixtures."""

import os
from pathlib import Path

import pytest

from solver.survey.memory import reuse_freed_memory

# As the command does.
reuse_freed_memory()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Keep detections of tests apart from the user's."""
    os.environ["ROADFIBER_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real files; tests that need it skip, visibly, where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data not beside this checkout (../shared/data)")
    return folder
