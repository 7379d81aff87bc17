"""Shared fixtures."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from solver.survey.memory import reuse_freed_memory

# As the command does.
reuse_freed_memory()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Keep detections of tests apart from the user's."""
    os.environ["ROADFIBER_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """A browser; one for all tests, as Playwright can be begun once in a process."""
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no chromium on the PATH")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real files; tests that need it skip, visibly, where it is absent."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data not beside this checkout (../shared/data)")
    return folder
