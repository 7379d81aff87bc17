"""Users' own effects: from a file of theirs (`--plugin`), or from packages that declare entry points."""

import importlib.util
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from solver.effects.catalogue import built_in
from solver.effects.effect import Effect
from solver.effects.guard import guarded, running
from vision.contract import InputError

#: Entry-point group: `[project.entry-points."roadfiber.effects"] name = "package.module"`, or "package.module:effect".
GROUP = "roadfiber.effects"


def effects_in(module: ModuleType) -> list[Effect]:
    """Effects that a module defines, each once; built-in ones that it imports are not its own."""
    found = {id(value): value for value in vars(module).values() if isinstance(value, Effect)}
    return [value for value in found.values() if built_in().get(value.name) is not value]


def load_plugin(path: Path) -> list[Effect]:
    """Read the effects that a file defines at its top level.

    Raises
    ------
    InputError
        If the file cannot be read or run, or defines none.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"--plugin {path}: no such file; give a Python file with an @effect function")
    name = f"roadfiber_plugin_{path.stem.replace('-', '_')}_{abs(hash(path.resolve()))}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    with importing(f"--plugin {path}", "mend the file"):
        spec.loader.exec_module(module)
    found = effects_in(module)
    if not found:
        raise InputError(f"--plugin {path}: defines no effect; decorate a function with @effect(...) of solver.effects")
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


S = TypeVar("S", Path, EntryPoint)


@cache
def proved(load: Callable[[S], list[Effect]], source: S, who: str, version: str) -> list[Effect]:
    """Effects that `load` finds in `source`, under guard, once a trial of them in a process of its own has passed.

    `version` tells an edited file from the one that was tried before.
    """
    from solver.effects.proof import prove

    prove(load, source, who)
    return [guarded(one) for one in load(source)]


def catalogue(plugins: Sequence[Path] = ()) -> dict[str, Effect]:
    """All effects by name: built in, installed and from `plugins`.

    Those that are not built in are verified in a process of their own and run under guard, see `solver.effects.guard`.

    Raises
    ------
    InputError
        If two have the same name, one cannot be loaded, or one breaks a promise, see `solver.effects.verify`.
    """
    effects = dict(built_in())
    more = [proved(load_point, one, entry_words(one), "") for one in entry_points(group=GROUP)]
    # A run folder keeps a copy of the plugin it was made with: the same file again is not another.
    files = {path.read_bytes() if path.is_file() else b"": path for path in map(Path, plugins)}
    for content, path in files.items():
        more.append(proved(load_plugin, path, f"--plugin {path}", sha256(content).hexdigest()))
    for one in (one for found in more for one in found):
        if one.name in effects:
            raise InputError(f"effect {one.name}: is in the catalogue already; give yours another name")
        effects[one.name] = one
    return effects
