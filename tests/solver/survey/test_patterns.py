"""Name patterns of a site.toml that may come from a stranger."""

import os
from pathlib import Path

import pytest

from solver.survey import patterns
from solver.survey.patterns import files_matching


@pytest.fixture
def tree(tmp_path) -> Path:
    for name in ("a.h5", "b.csv", "das/c.h5", "das/day/d.h5", "das/day/.e.h5", "other/x.h5"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "das" / "loop").symlink_to(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("*.h5", "a.h5"),
        ("das/c.h5", "das/c.h5"),
        ("das/**/*.h5", "das/c.h5 das/day/d.h5 das/day/.e.h5"),
        ("**/?.h5", "a.h5 das/c.h5 das/day/d.h5 other/x.h5"),
        ("d*/*/[a-d].h5", "das/day/d.h5 das/loop/a.h5"),
        ("*/../b.csv", "das/../b.csv other/../b.csv"),
        ("das", ""),
        ("**", ""),
        ("", ""),
        ("nowhere/*", ""),
        ("a.h5/*", ""),
    ],
)
def test_patterns_match_as_in_a_shell(tree, pattern, names):
    assert {str(path.relative_to(tree)) for path in files_matching(pattern, tree)} == set(names.split())


def test_an_absolute_pattern_may_name_folders_but_not_search_them(tree):
    assert files_matching(f"{tree}/das/*.h5", Path("/")) == {tree / "das" / "c.h5"}
    for pattern in ("/**", f"{tree}/**/*.h5", "../**/*.h5"):
        with pytest.raises(ValueError, match=r"\*\* goes below it only"):
            files_matching(pattern, tree)


def test_no_more_is_looked_at_than_a_survey_may_have(tree, monkeypatch):
    monkeypatch.setattr(patterns, "MOST", 500)
    (tree / "many").mkdir()
    for number in range(600):
        (tree / "many" / str(number)).touch()
    looked = []
    scan = os.scandir
    monkeypatch.setattr(os, "scandir", lambda folder: looked.append(folder) or scan(folder))
    with pytest.raises(ValueError, match="goes through over 500 files and folders; name the folder of yours"):
        files_matching("**/*.h5", tree)
    assert files_matching("das/**/*.h5", tree)
    with pytest.raises(ValueError, match="goes through over"):
        files_matching("/*/*/*/*/*/*", tree)
    assert len(looked) < 1000


def test_a_folder_that_may_not_be_looked_into_is_passed_over(tree, monkeypatch):
    def refusing(folder):
        if folder.name == "day":
            raise PermissionError(13, "Permission denied")
        return scan(folder)

    scan = os.scandir
    monkeypatch.setattr(os, "scandir", refusing)
    assert files_matching("das/**/*.h5", tree) == {tree / "das" / "c.h5"}
