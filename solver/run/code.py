"""Users' effects in a run: what it keeps of their files, and which files its model needs to be evaluated again.

A run folder is data. It holds the text of users' files for people to read; no command runs it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from solver.catalogue.catalogue import built_in
from solver.catalogue.plugins import Plugin
from solver.effect import Effect
from solver.run.run import Run
from vision.contract import InputError


class Absent:
    """An effect of a run whose code is missing: it has a name; any other attribute says which file to give."""

    def __init__(self, name: str, advice: str) -> None:
        self.name, self.advice = name, advice

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        raise InputError(self.advice)


def advice_on(name: str, plugins: Sequence[Mapping[str, Any]]) -> str:
    """What to give where an effect's code is needed, given the `plugins` of fit.json.

    >>> advice_on("grip", [{"file": "mine.py", "sha256": "ab12", "effects": ["grip"]}])
    'this run was made with mine.py (sha256 ab12): give it with --plugin mine.py'
    """
    for one in plugins:
        if name in one["effects"]:
            return f"this run was made with {one['file']} (sha256 {one['sha256']}): give it with --plugin {one['file']}"
    return f"this run was made with the effect {name}, which is not installed: give its file with --plugin"


def finder(plugins: Sequence[Mapping[str, Any]], given: Iterable[Effect]) -> Callable[[str], Effect]:
    """Look effects up by name: built in, `given`, or else `Absent`; `plugins` are those of fit.json."""
    known = built_in() | {one.name: one for one in given}

    def look_up(name: str) -> Effect:
        return known[name] if name in known else cast(Effect, Absent(name, advice_on(name, plugins)))

    return look_up


def check_plugins(facts: Mapping[str, Any], plugin_of: Mapping[str, Plugin]) -> None:
    """Refuse a file that defines effects of a run and is not the file they were fitted with.

    Raises
    ------
    InputError
        If it has another checksum than the run says.
    """
    for made in facts["plugins"]:
        for plugin in {plugin_of[name] for name in made["effects"] if name in plugin_of}:
            if plugin.sha256 != made["sha256"]:
                raise InputError(
                    f"--plugin {plugin}: has sha256 {plugin.sha256}, and this run was made with {made['file']} "
                    f"(sha256 {made['sha256']}): give that, or say --plugin-changed to go on with yours"
                )


def with_plugins(run: Run) -> Run:
    """The run, which keeps the files of the users' effects in its model."""
    used: dict[Plugin, list[str]] = {}
    for one in run.problem.effects:
        if one.name in run.known.plugin_of:
            used.setdefault(run.known.plugin_of[one.name], []).append(one.name)
    kept = [
        {"file": plugin.path.name, "sha256": plugin.sha256, "effects": names, "text": plugin.text}
        for plugin, names in used.items()
    ]
    return replace(run, facts=run.facts | {"plugins": kept})
