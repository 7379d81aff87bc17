"""What the examples of the Python door stand on: a small survey and its run, made once."""

from typing import Any

import pytest


@pytest.fixture(scope="session")
def example(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Names that the examples in `roadfiber/` use: `folder`, `survey`, `run`, and a `table` of tracks."""
    import roadfiber as rf

    folder = tmp_path_factory.mktemp("example")
    small = {"view": (0.0, 40.0), "channels": 121, "passes": 4, "seed": 3, "laid": "winding"}
    survey = rf.read(rf.simulate(folder / "survey", "street-paper", **small).site)
    run = rf.locate(survey, effects=[], corridor="fit")
    return {"rf": rf, "folder": folder, "survey": survey, "run": run, "table": survey.tracks}


@pytest.fixture(autouse=True)
def examples_of_the_door(request: pytest.FixtureRequest, doctest_namespace: dict[str, Any]) -> None:
    """Give the names to the examples of the door alone; others need no survey."""
    if isinstance(request.node, pytest.DoctestItem) and request.node.path.parent.name == "roadfiber":
        doctest_namespace.update(request.getfixturevalue("example"))
