"""Accuracy classes of a route in the words of PAS 128 and ASCE 38-22, with what they claim and what they do not.

PAS 128:2022 (BSI) grades detection by location accuracy: QL-B1 +-150 mm or 15 % of the depth, whichever is greater,
across, and 15 % of the depth in depth; QL-B2 +-250 mm or 40 %, and 40 %; QL-B3 +-500 mm, depth undefined; QL-B4 an
assumed route. It does not say at which confidence; here the 95 % half-width must be within it. QL-B1 asks for more than
one detection technique, and Survey Type B for electromagnetic location and radar beside any other: a route from DAS
alone is told as QL-B2 at best, and as no survey to PAS 128 by itself. QL-A is exposure.

ASCE/UESI/CI 38-22 grades evidence, not numbers: level D records, C records joined to what is seen on the surface, B
surface geophysical methods, A exposure at a point; a professional assigns it. A route that the data decide is evidence
of the kind of level B; where they do not decide there is none.

Neither text was at hand. The numbers are those that survey firms publish of PAS 128 (selectsurveys.com/service/pas128:
500 mm; 250 mm and 40 %; more than one technique, 150 mm and 15 %), the words those that engineers quote of ASCE 38-22.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import TRUSTED, Placed
from solver.run.geojson import Z95, half_width

Array = NDArray[np.float64]

#: (class, m across, share of the depth that widens it, share of the depth in depth; infinite: depth undefined).
PAS128 = (("QL-B1", 0.15, 0.15, 0.15), ("QL-B2", 0.25, 0.40, 0.40), ("QL-B3", 0.50, 0.0, np.inf))
ASSUMED, NONE = "QL-B4", "none"
#: Best class of one detection technique.
BEST_ALONE = "QL-B2"

CLAIM = (
    "Classes follow from the half-widths of the 95 % corridor, and hold if that does. PAS 128: QL-B2 at best, "
    "since one detection technique was used; it is no survey to PAS 128 by itself, which asks for electromagnetic "
    "location and radar too, and nothing here is QL-A, which needs exposure. ASCE 38-22: evidence of the kind of QLB "
    "(surface geophysics); the level itself is a professional's to assign, and QLA needs exposure at the point. "
    "Numbers and words are those that surveyors publish of the standards, whose text was not at hand: check them."
)


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of a route, point by point.

    Parameters
    ----------
    across, depth : [channel], 95 % half-widths, m; NaN where not known
    pas128 : [channel], quality level that may be told: QL-B2, QL-B3, QL-B4 (assumed) or none
    within : [channel], the best quality level whose numbers are met, were there a second technique: QL-B1 too
    asce38 : [channel], "QLB evidence" where data and anchors decide, else "none"
    """

    across: Array
    depth: Array
    pas128: NDArray[np.str_]
    within: NDArray[np.str_]
    asce38: NDArray[np.str_]


def accuracy_of(place: Placed) -> Accuracy:
    """Accuracy classes of a route.

    Parameters
    ----------
    place : with covariance, and the grade of the run's checks: where one failed no class is told

    >>> channel, route = np.arange(3), np.array([[0.0, 4, 1], [1, 4, 1], [2, 4, 1]])
    >>> covariance = np.array([np.diag([s**2, s**2, s**2]) for s in (0.05, 0.1, 0.3)])
    >>> found = accuracy_of(Placed(channel, channel * 1.0, route, covariance, np.array([True, True, True])))
    >>> found.pas128.tolist(), found.within.tolist()
    (['QL-B2', 'QL-B2', 'none'], ['QL-B1', 'QL-B2', 'none'])
    """
    across, depth = half_width(place.route, place.covariance), Z95 * place.sigma[:, 2]
    z = np.maximum(place.route[:, 2], 0.0)
    known = place.constrained & np.isfinite(across) & (place.grade in TRUSTED)
    within = np.full(len(z), NONE, dtype="<U8")
    for name, least, share, in_depth in reversed(PAS128):
        met = (across <= np.maximum(least, share * z)) & (np.isinf(in_depth) or depth <= in_depth * z)
        within[known & met] = name
    alone = np.where(within == PAS128[0][0], BEST_ALONE, within)
    alone = np.where(place.constrained, alone, ASSUMED) if place.grade in TRUSTED else np.full(len(z), NONE)
    return Accuracy(across, depth, alone, within, np.where(known, "QLB evidence", NONE))


def share_lines(accuracy: Accuracy) -> list[str]:
    """How much of the route has each class, a line each.

    >>> told = np.array(["QL-B2", "none"])
    >>> share_lines(Accuracy(np.zeros(2), np.zeros(2), told, told, told))
    ['QL-B2: 50 % of the channels', 'none: 50 % of the channels']
    """
    order = (*(name for name, *_ in PAS128), ASSUMED, NONE)
    shares = {name: float((accuracy.pas128 == name).mean()) for name in order}
    return [f"{name}: {100 * share:.0f} % of the channels" for name, share in shares.items() if share > 0]
