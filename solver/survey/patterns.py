"""Find files by name patterns from an untrusted site.toml, such as `das/*.h5`, without searching the whole disk."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

#: Most files and folders that one pattern may visit: a survey of a month in files of a minute has half as many.
MOST = 100_000
WILD = "*?["


@dataclass
class Search:
    """The search for one pattern; `left` is how many folder entries it may still visit."""

    pattern: str
    left: int

    def entries(self, folder: Path) -> list[os.DirEntry[str]]:
        """The entries of a folder; nothing if it cannot be listed.

        Raises
        ------
        ValueError
            If the pattern visits too many entries.
        """
        found: list[os.DirEntry[str]] = []
        try:
            with os.scandir(folder) as listing:
                for entry in listing:
                    self.left -= 1
                    if self.left < 0:
                        raise ValueError(
                            f"{self.pattern!r} goes through over {MOST:,} files and folders; name the folder of yours"
                        )
                    found.append(entry)
        except OSError:
            return []
        return found

    def matches(self, at: Path, parts: tuple[str, ...]) -> Iterator[Path]:
        """Files that match the parts of a pattern from a folder; `**` is any number of folders and follows no links."""
        if not parts:
            if at.is_file():
                yield at
            return
        part, rest = parts[0], parts[1:]
        if part == "**":
            yield from self.matches(at, rest)
            for entry in self.entries(at):
                if entry.is_dir(follow_symlinks=False):
                    yield from self.matches(at / entry.name, parts)
        elif any(letter in part for letter in WILD):
            for entry in self.entries(at):
                if fnmatch(entry.name, part):
                    yield from self.matches(at / entry.name, rest)
        else:
            yield from self.matches(at / part, rest)


def files_matching(pattern: str, folder: Path) -> set[Path]:
    """Return the files that a pattern matches from a folder.

    Parameters
    ----------
    pattern : of names, with `*`, `?` and `[...]`; `**` is any number of folders below `folder`
    folder : where the search starts, unless the pattern is absolute

    Raises
    ------
    ValueError
        If `**` would search outside of `folder`, or the pattern visits more than `MOST` entries.
    """
    parts = Path(pattern).parts
    if "**" in parts and (Path(pattern).is_absolute() or ".." in parts):
        raise ValueError(f"{pattern!r} searches outside the site file's folder; ** goes below it only")
    return set(Search(pattern, MOST).matches(folder, parts))
