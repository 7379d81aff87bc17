"""Users' own effects: from a file of theirs (`--plugin`), or from packages that declare entry points."""

import importlib.util
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from solver.effects.catalogue import built_in
from solver.effects.effect import Effect
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
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"--plugin {path}: {type(error).__name__}: {error}; mend the file") from error
    found = effects_in(module)
    if not found:
        raise InputError(f"--plugin {path}: defines no effect; decorate a function with @effect(...) of solver.effects")
    return found


def installed() -> list[Effect]:
    """Effects of installed packages that declare the entry point `roadfiber.effects`: a module of them, or one.

    Raises
    ------
    InputError
        If one cannot be loaded.
    """
    found = []
    for point in entry_points(group=GROUP):
        try:
            loaded = point.load()
        except Exception as error:
            raise InputError(
                f"entry point {point.name} ({point.value}): {type(error).__name__}: {error}; "
                "mend or uninstall the package"
            ) from error
        found += [loaded] if isinstance(loaded, Effect) else effects_in(loaded)
    return found


def catalogue(plugins: Sequence[Path] = ()) -> dict[str, Effect]:
    """All effects by name: built in, installed and from `plugins`; those that are not built in are verified.

    Raises
    ------
    InputError
        If two have the same name, or one breaks a promise, see `solver.effects.verify`.
    """
    from solver.effects.verify import verify

    effects = dict(built_in())
    # A run folder keeps a copy of the plugin it was made with: the same file again is not another.
    files = {path.read_bytes() if path.is_file() else path: path for path in map(Path, plugins)}
    for one in [*installed(), *(one for path in files.values() for one in load_plugin(path))]:
        if one.name in effects:
            raise InputError(f"effect {one.name}: is in the catalogue already; give yours another name")
        verify(one)
        effects[one.name] = one
    return effects
