"""A route as coordinates of a DASCore patch."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vision.contract import InputError

if TYPE_CHECKING:
    import pandas as pd

#: Columns of a route that become coordinates.
NAMES = ("x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "latitude", "longitude")
#: Share of the channel spacing by which a patch's channels may be off the route's.
NEAR = 0.5


def with_route(patch: Any, route: "pd.DataFrame") -> Any:
    """The patch with the route as coordinates along its distance.

    Parameters
    ----------
    patch : `dascore.Patch` with a dimension `distance`, m along the fiber as in the record that was located
    route : table as of `Run.route`

    Returns
    -------
    patch : with coordinates x, y, z (m), sigma_x, sigma_y, sigma_z (m), latitude and longitude (degrees); NaN where
        the route does not reach, and where neither data nor anchors decide it; and the attributes route_trust, the
        grade of the run's checks, and route_reason, why it is not to be relied on, or what its corridor leaves out

    Raises
    ------
    InputError
        If it has no distance, or none of its channels is on the route.
    """
    if "distance" not in getattr(patch, "dims", ()):
        raise InputError("patch: has no dimension distance; give a dascore.Patch of the record that was located")
    at = np.asarray(patch.get_coord("distance").data, float)
    known = route["distance"].to_numpy()
    spacing = float(np.median(np.diff(known)))
    nearest = np.abs(known[None, :] - at[:, None]).argmin(1)
    there = np.abs(known[nearest] - at) < NEAR * spacing
    if not there.any():
        raise InputError(
            f"patch: its distances, {at.min():g} to {at.max():g} m, are not on the route, {known[0]:g} to "
            f"{known[-1]:g} m; give the record that was located"
        )
    sure = there & route["constrained"].to_numpy()[nearest]
    values = {name: np.where(sure, route[name].to_numpy()[nearest], np.nan) for name in NAMES}
    said = {
        "route_trust": route["trust"].iloc[0],
        "route_reason": "; ".join(dict.fromkeys(route["reason"][nearest[sure]])),
    }
    return patch.update_attrs(**said).update_coords(**{name: ("distance", value) for name, value in values.items()})
