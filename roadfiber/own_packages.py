"""That `solver`, `vision` and `calib` are roadfiber's own: their names are short, and others may have them too."""

import sys
from importlib.util import find_spec
from pathlib import Path

OWN = ("solver", "vision", "calib")


def places(name: str) -> list[Path]:
    """Where a package would be imported from; nothing where it is not found.

    >>> [place.name for place in places("roadfiber")]
    ['roadfiber']
    """
    try:
        spec = find_spec(name)
    except ValueError:  # a module without a spec, made by hand
        spec = None
    if spec is None:
        known = getattr(sys.modules.get(name), "__file__", None)
        return [Path(known).parent] if known else []
    return [Path(one) for one in spec.submodule_search_locations or [spec.origin or name]]


def foreign(beside: Path) -> list[str]:
    """What stands in the way of roadfiber's own packages, a line each; nothing where all are its own.

    Parameters
    ----------
    beside : folder that holds `roadfiber`, and should hold the others
    """
    wrong = []
    for name in OWN:
        found = places(name)
        if not found:
            wrong.append(f"{name} is missing from {beside}; install roadfiber again")
        elif not any(place.resolve() == (beside / name).resolve() for place in found):
            wrong.append(f"{name} is taken from {found[0]}; roadfiber's is {beside / name}: rename or remove the other")
    return wrong


def require_own(beside: Path) -> None:
    """Refuse to go on with packages that are not roadfiber's; folders of data that have their names do no harm.

    Raises
    ------
    ImportError
        If another package or file of the same name stands before one of `OWN` on `sys.path`.
    """
    # An editable install is asked only where a whole path knows no folder of that name; on the path packages win over
    # folders of data, in whatever order.
    if str(beside) not in sys.path:
        sys.path.append(str(beside))
    if wrong := foreign(beside):
        raise ImportError(f"roadfiber: {'; '.join(wrong)}")
