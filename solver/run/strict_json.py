"""JSON as every reader takes it: no NaN, no infinity."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def strict(value: Any) -> Any:
    """Return `value` as strict JSON holds it: numbers that are not finite become None.

    >>> from pathlib import Path
    >>> strict({"a": np.float64("nan"), "b": (np.int64(2), Path("c.h5")), "d": np.bool_(True)})
    {'a': None, 'b': [2, 'c.h5'], 'd': True}
    """
    if isinstance(value, Mapping):
        return {str(key): strict(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return strict(value.tolist())
    if isinstance(value, list | tuple):
        return [strict(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
