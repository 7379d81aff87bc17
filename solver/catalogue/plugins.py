"""Users' own effects: from a file of theirs (`--plugin`), or from packages that declare entry points.

No other file's code is run, least of all one that lies in a run folder.
"""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from solver.catalogue.catalogue import built_in
from solver.catalogue.guard import guarded, running
from solver.effect import Effect
from vision.contract import InputError

#: Entry-point group: `[project.entry-points."roadfiber.effects"] name = "package.module"`, or "package.module:effect".
GROUP = "roadfiber.effects"


#: Bytes of a plugin's file; a run keeps its text.
LARGEST = 2**20


@dataclass(frozen=True)
class Plugin:
    """A file with effects of a user's: where it is, and all that it says."""

    path: Path
    text: str

    def __str__(self) -> str:
        return str(self.path)

    @property
    def sha256(self) -> str:
        """Checksum of the file, hexadecimal."""
        return sha256(self.text.encode("utf-8")).hexdigest()


class Catalogue(dict[str, Effect]):
    """Effects by name; `plugin_of` has the files, by the names of the effects that came from one."""

    def __init__(self, effects: Mapping[str, Effect], plugin_of: Mapping[str, Plugin]) -> None:
        super().__init__(effects)
        self.plugin_of = dict(plugin_of)

    def extended(self, effects: Iterable[Effect]) -> "Catalogue":
        """The catalogue with a user's effects, given as objects; those that are in it already change nothing.

        Raises
        ------
        InputError
            If one has the name of another effect, or breaks a promise, see `solver.catalogue.verify`.
        """
        from solver.catalogue.verify import verify

        more = {one.name: one for one in effects if self.get(one.name) is not one}
        for one in more.values():
            if one.name in self:
                raise InputError(f"effect {one.name}: is in the catalogue already; give yours another name")
            verify(one)
        return Catalogue(self | more, self.plugin_of) if more else self


def effects_in(module: ModuleType) -> list[Effect]:
    """Effects that a module defines, each once; built-in ones that it imports are not its own."""
    found = {id(value): value for value in vars(module).values() if isinstance(value, Effect)}
    return [value for value in found.values() if built_in().get(value.name) is not value]


def read_plugin(path: Path) -> Plugin:
    """Read a file of effects; nothing of it is run.

    Raises
    ------
    InputError
        If there is no such file, or it is not text of at most `LARGEST` bytes.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"--plugin {path}: no such file; give a Python file with an @effect function")
    try:
        with path.open("rb") as stream:
            content = stream.read(LARGEST + 1)
        text = content.decode("utf-8")
    except OSError as error:
        raise InputError(f"--plugin {path}: cannot be read ({error.strerror}); mend its permissions") from error
    except UnicodeDecodeError as error:
        raise InputError(f"--plugin {path}: not UTF-8 text ({error.reason}); give a Python file") from error
    if len(content) > LARGEST:
        raise InputError(f"--plugin {path}: over {LARGEST >> 20} MiB; give a Python file with an @effect function")
    return Plugin(path, text)


def load_plugin(plugin: Plugin) -> list[Effect]:
    """Run a file of effects: they are those that it defines at its top level.

    What is run is what the checksum is of: no compiled copy beside the file is looked at, and none is written.

    Raises
    ------
    InputError
        If the file cannot be run, or defines none.
    """
    module = ModuleType(f"roadfiber_plugin_{plugin.sha256}")
    module.__file__ = str(plugin)
    sys.modules[module.__name__] = module  # where dataclasses look their module up
    with importing(f"--plugin {plugin}", "mend the file"):
        exec(compile(plugin.text.encode("utf-8"), str(plugin), "exec"), vars(module))
    found = effects_in(module)
    if not found:
        raise InputError(
            f"--plugin {plugin}: defines no effect; decorate a function with @effect(...) of solver.effect"
        )
    return found


def load_point(point: EntryPoint) -> list[Effect]:
    """Load the effects of an entry point: a module of them, or one.

    Raises
    ------
    InputError
        If it cannot be loaded.
    """
    with importing(entry_words(point), "mend or uninstall the package"):
        loaded = point.load()
    return [loaded] if isinstance(loaded, Effect) else effects_in(loaded)


def entry_words(point: EntryPoint) -> str:
    """Name an entry point in messages."""
    return f"entry point {point.name} ({point.value})"


@contextmanager
def importing(who: str, mend: str) -> Iterator[None]:
    """Import what is not ours: it prints aside, and whatever it raises is told in a line."""
    try:
        with running(f"{who}:"):
            yield
    except InputError:
        raise
    except Exception as error:
        told = " ".join(str(error).split())
        raise InputError(f"{who}: {type(error).__name__}: {told}; {mend}") from error


S = TypeVar("S", Plugin, EntryPoint)


@cache
def proved(load: Callable[[S], list[Effect]], source: S, who: str) -> list[Effect]:
    """Effects that `load` finds in `source`, under guard, once a trial of them in a process of its own has passed."""
    from solver.catalogue.proof import prove

    prove(load, source, who)
    return [guarded(one) for one in load(source)]


def catalogue(plugins: Sequence[Path] = ()) -> Catalogue:
    """All effects by name: built in, installed and from `plugins`.

    Those that are not built in are verified in a process of their own and run under guard, see `guard.py`.

    Raises
    ------
    InputError
        If two have the same name, one cannot be loaded, or one breaks a promise, see `solver.catalogue.verify`.
    """
    effects, plugin_of = dict(built_in()), {}
    # The same file again, under whatever name, is not another.
    files = {one.text: one for one in map(read_plugin, plugins)}.values()
    more = [(one, None) for point in entry_points(group=GROUP) for one in proved(load_point, point, entry_words(point))]
    mine = [(one, plugin) for plugin in files for one in proved(load_plugin, plugin, f"--plugin {plugin}")]
    for one, plugin in [*more, *mine]:
        if one.name in effects:
            raise InputError(f"effect {one.name}: is in the catalogue already; give yours another name")
        effects[one.name] = one
        if plugin is not None:
            plugin_of[one.name] = plugin
    return Catalogue(effects, plugin_of)
