"""The checks that a fit can pass or fail.

Each compares a number with what noise or stated uncertainties would make it, and fails where chance alone would exceed
it less often than `ALARM`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from solver.fit.held_out import HeldOut
from solver.fit.map_fit import SPLINE_VARIANCE
from solver.fit.problem import Problem
from solver.fit.result import FitResult, Parameter
from solver.run.floor import Floor
from solver.run.trust import DIAGNOSE, Gate, Trust, Verdict
from solver.survey.anchors import Anchor
from solver.trajectory.agreement import WHERE_FROM
from solver.trajectory.trajectory_effects import COMMON_ERRORS
from solver.trajectory.vehicle_pass import Pass

Array = NDArray[np.float64]

#: Chance that a check fails where nothing is wrong.
ALARM = 1e-3
#: Standard deviations that chance exceeds as rarely.
BEYOND = float(-ndtri(ALARM))
#: Share of an error that the fit may take up before a check that passes says little.
TAKEN_UP = 0.9

CLOCK = "`roadfiber clock RUN` estimates the clocks' offset"
#: Where nothing tells anchors, tracks and record apart, in one line.
FRAME = f"check the anchors against {WHERE_FROM}"
READ = "see what was read of the record (`roadfiber view SITE`)"


def trust_of(
    result: FitResult, problem: Problem, floor: Floor | None, held_out: HeldOut | None, disputed: Sequence[str] = ()
) -> Trust:
    """Check a fit.

    Parameters
    ----------
    result, problem : the fit, and what was fitted
    floor : that noise alone would leave; None where it is not known
    held_out : misfit of passes that the fit has not seen; None where there is none
    disputed : sentences on anchors that contradict the others, see `solver.fit.anchor_check`
    """
    fitted, unseen = misfit_gate(result, floor), held_out_gate(held_out, floor)
    return Trust.of(
        [
            converged_gate(result),
            with_share(fitted, unseen),
            unseen,
            anchor_gate(result, problem.anchors, disputed, explained=not fitted.failed),
            *track_gates(result, problem),
            *wander_gates(result, problem),
            *common_gates(result, problem),
            *ground_gates(result, problem),
            *side_gates(result),
            *discrepancy_gates(problem),
        ]
    )


def converged_gate(result: FitResult) -> Gate:
    """Whether the fit came to an end."""
    if result.converged:
        return Gate("converged", "passed", "converged")
    words = f"not converged in {result.iterations} steps"
    return Gate("converged", "failed", words, (READ, "check tracks, clocks and anchors"))


def judged(value: float, expected: float, scatter: float) -> Verdict:
    """Whether a misfit is more than chance."""
    return "passed" if value <= expected + BEYOND * scatter else "failed"


def misfit_gate(result: FitResult, floor: Floor | None) -> Gate:
    """The misfit against its own noise floor."""
    value = result.chi2_per_dof
    if floor is None:
        words = f"the misfit, {value:.3f}, since too few samples without a vehicle near tell the noise"
        return Gate("misfit", "open", words, found=value)
    scatter = floor.scatter(max(result.chi2 / value, 1.0)) if value > 0 else float("nan")
    verdict = judged(value, floor.value, scatter)
    leaves = "leaves at most" if floor.bound else "leaves"
    words = f"misfit {value:.3f} where noise alone {leaves} {floor.value:.3f} ± {scatter:.3f}"
    return Gate("misfit", verdict, words, (DIAGNOSE,), value, floor.value, scatter)


def held_out_gate(held_out: HeldOut | None, floor: Floor | None) -> Gate:
    """The misfit of passes that the fit has not seen, with what the uncertainty of the route adds to it."""
    if held_out is None or floor is None:
        why = "the noise is not known" if held_out else "there are none"
        return Gate("held-out passes", "open", f"passes held out, since {why}")
    value, freedom = held_out.chi2_per_dof, held_out.freedom
    expected = floor.value + held_out.blurred / freedom
    scatter = float(np.hypot(floor.scatter(freedom), held_out.blur**0.5 / freedom))
    verdict = judged(value, expected, scatter)
    words = f"{value:.3f} on passes held out where {expected:.3f} ± {scatter:.3f} is expected"
    return Gate("held-out passes", verdict, words, (DIAGNOSE,), value, expected, scatter)


def with_share(fitted: Gate, unseen: Gate) -> Gate:
    """The misfit's gate with the share of the held-out passes' excess that a fit of them takes up."""
    excess = unseen.found - unseen.expected
    if not unseen.failed or not excess > 0:
        return fitted
    share = float(np.clip(1 - (fitted.found - fitted.expected) / excess, 0.0, 1.0))
    return replace(fitted, taken_up=share)


def misses(result: FitResult, anchors: Sequence[Anchor]) -> tuple[Array, Array]:
    """How far each anchor is from the route, and its sigmas, [anchor, 3], m."""
    at = np.array([one.channel for one in anchors])
    route = np.column_stack([np.interp(at, result.channel, column) for column in result.route.T])
    miss = np.array([[one.x, one.y, one.z] for one in anchors]) - route
    return miss, np.array([[one.sigma_xy, one.sigma_xy, one.sigma_z] for one in anchors])


def birge(result: FitResult, anchors: Sequence[Anchor]) -> float:
    """The factor that a result's covariances already have, see `solver.fit.posterior.Posterior.scale`."""
    miss, sigma = misses(result, anchors) if anchors else (np.zeros(1), np.ones(1))
    return max(1.0, result.chi2_per_dof, float(np.mean((miss / sigma) ** 2)))


def left_of(result: FitResult, anchors: Sequence[Anchor]) -> tuple[Array, Array]:
    """Squared distance [anchor] of the route from each anchor in units of what is expected, and the share taken up.

    The route is drawn to an anchor: of the anchor's error, variance s^2, only s^2 - c is left to see, with the route's
    own variance c there (Cook 1977, Technometrics 19, 15). Chi-square of 3 degrees of freedom.
    """
    miss, sigma = misses(result, anchors)
    near = np.abs(result.channel[:, None] - np.array([one.channel for one in anchors])).argmin(0)
    # Tails of the prior on the shape are no part of the fit: with them a route follows an anchor more than wholly.
    fitted = (result.covariance - result.tails)[near]
    followed = fitted / birge(result, anchors) / (sigma[:, :, None] * sigma[:, None, :])
    values, axes = np.linalg.eigh(np.eye(3) - np.nan_to_num(followed))
    turned = np.einsum("aji,aj->ai", axes, miss / sigma)
    # A route that takes up nearly all says little of the rest: tails of the prior pull on, and are no Gaussian.
    square = (turned**2 / np.maximum(values, 1 - TAKEN_UP)).sum(1)
    return square, np.clip(np.diagonal(followed, axis1=1, axis2=2), 0.0, 1.0)


def anchor_gate(result: FitResult, anchors: Sequence[Anchor], disputed: Sequence[str], explained: bool = True) -> Gate:
    """The route at each anchor against the anchor's sigmas, given that the anchor draws the route to itself.

    Parameters
    ----------
    disputed : sentences on anchors that contradict the others
    explained : whether the model explains the record: else it, or what was read, may be wrong, and not an anchor
    """
    first = () if explained else (READ,)
    mend, unclear = (*first, "check the channels and coordinates of the anchors"), (*first, FRAME)
    if disputed:
        found = "; ".join(line.split("; ")[0] for line in disputed)
        return Gate("anchors", "failed", found, mend if anchors else unclear)
    if not anchors:
        return Gate("anchors", "open", "anchors, since there are none")
    miss, sigma = misses(result, anchors)
    off, distance = np.abs(miss / sigma).max(1), np.linalg.norm(miss, axis=1)
    square, share = left_of(result, anchors)
    wrong = np.flatnonzero(chdtrc(3, square) * len(anchors) < ALARM).tolist()
    count = "1 anchor" if len(anchors) == 1 else f"{len(anchors)} anchors"
    words = f"{count} within {off.max():.1f} sigmas of the route"
    gate = Gate("anchors", "passed", words, mend, float(off.max()), 0.0, 1.0, float(share.mean()))
    if wrong:
        said = (f"anchor {anchors[i].name} {distance[i]:.2f} m off the route ({off[i]:.1f} sigmas)" for i in wrong)
        alone = unclear if len(wrong) == len(anchors) else mend
        return replace(gate, verdict="failed", words="; ".join(said), mend=alone)
    return little(gate, "the route follows them")


def little(gate: Gate, why: str) -> Gate:
    """A gate that passed, or an open one where the fit takes up nearly all that it would show."""
    if not gate.taken_up > TAKEN_UP:
        return gate
    return replace(gate, verdict="open", words=f"{gate.name}, since {why} ({100 * gate.taken_up:.0f} %)")


def stated(one: Pass) -> float:
    """Uncertainty that a track states of itself, m: the root mean square over its fixes in view."""
    seen = one.sigma[one.in_view]
    return float(np.sqrt((seen**2).mean())) if len(seen) else 0.0


def shifts(result: FitResult, name: str) -> dict[str, list[Parameter]]:
    """Fitted shifts `along` or `across` by track; one of each stretch of a long fiber."""
    found: dict[str, list[Parameter]] = {}
    for key, value in result.parameters.items():
        base, _, track = key.partition("[")
        if base == name and value.free:
            found.setdefault(track.rstrip("]").partition(" at x ")[0], []).append(value)
    return found


def track_gates(result: FitResult, problem: Problem) -> list[Gate]:
    """The shifts of whole tracks along travel and sideways against what tracks may be off."""
    scale, gates = birge(result, problem.anchors), []
    for name, way in (("along", "along travel"), ("across", "sideways")):
        by_track, size = shifts(result, name), getattr(problem.prior, name)
        known = [(value, one) for one in problem.passes for value in by_track.get(one.track_id, [])]
        if not known:
            continue
        sd = np.array([np.hypot(np.hypot(size, one.offset), stated(one)) for _, one in known])
        shift, sigma = (np.array([getattr(value, what) for value, _ in known]) for what in ("value", "sigma"))
        rms, due = float(np.sqrt((shift**2).mean())), float(np.sqrt((sd**2).mean()))
        share = float(np.clip(sigma**2 / scale / sd**2, 0.0, 1.0).mean())
        failed = chdtrc(len(sd), float(((shift / sd) ** 2).sum())) < ALARM
        speed = np.array([one.speed for _, one in known])
        rivals = {CLOCK: np.abs(speed)} if name == "along" else {}
        rivals |= {FRAME: np.sign(speed)} if problem.anchors else {}
        mend = (*sorted(rivals, key=lambda one: unlike(shift, rivals[one])), DIAGNOSE)
        words = f"tracks shifted {rms:.2f} m {way} (rms) where {due:.2f} m is expected"
        gate = Gate(f"tracks {way}", "failed" if failed else "passed", words, mend, rms, 0.0, due, share)
        gates.append(gate if failed else little(gate, "the rest of the fit takes up their errors"))
    return gates


def unlike(shift: Array, shape: Array) -> float:
    """What is left of squared shifts [track] when the best multiple of a shape [track] is taken off.

    >>> unlike(np.array([1.0, -1.0, 1.0]), np.array([2.0, -2.0, 2.0])), unlike(np.ones(2), np.array([1.0, -1.0]))
    (0.0, 2.0)
    """
    return float(((shift - shape * (shape @ shift) / (shape @ shape)) ** 2).sum())


def wander_gates(result: FitResult, problem: Problem) -> list[Gate]:
    """That tracks wander by far more than they say, or one of them does; nothing where they do not."""
    slow = tuple(f"{one.name}." for one in problem.effects if one.slow_error)
    found = [value.value for name, value in result.parameters.items() if slow and name.startswith(slow) and value.free]
    size = np.array(found) / problem.prior.jitter
    if not len(size) or min(chdtrc(len(size), (size**2).sum()), chdtrc(1, (size**2).max()) * len(size)) >= ALARM:
        return []
    rms, due = (SPLINE_VARIANCE**0.5 * one * problem.prior.jitter for one in (float(np.sqrt((size**2).mean())), 1.0))
    words = f"tracks wander by {rms:.2f} m (rms) where {due:.2f} m is expected, {np.abs(size).max():.0f} sigmas at most"
    return [Gate("tracks' slow errors", "failed", words, (READ, DIAGNOSE), rms, 0.0, due)]


def common_gates(result: FitResult, problem: Problem) -> list[Gate]:
    """How far one camera puts all tracks off alike, against what they say; nothing without a camera."""
    found = {name: result.parameters[name] for name in problem.prior.effect_sd if name in result.parameters}
    size = np.array([one.value / problem.prior.effect_sd[name] for name, one in found.items()])
    if not len(size):
        return []
    titles = {f"{one.name}.{each.name}": one.title for one in COMMON_ERRORS for each in one.parameters}
    told = ", ".join(
        f"{titles[name].lower()}, {name.partition('.')[2]}: {one.value:.2g} {one.unit}".removesuffix(" 1")
        for name, one in found.items()
    )
    failed = chdtrc(len(size), (size**2).sum()) < ALARM
    words = f"all tracks off alike by {np.abs(size).max():.1f} sigmas at most" + (f" ({told})" if failed else "")
    mend = ("check the camera's calibration", FRAME, DIAGNOSE)
    return [Gate("tracks together", "failed" if failed else "passed", words, mend)]


def ground_gates(result: FitResult, problem: Problem) -> list[Gate]:
    """That Poisson's ratio is far from what was known of it; nothing where it is not."""
    (mean, sd), fitted = problem.prior.poisson_ratio, result.parameters.get("poisson_ratio")
    if fitted is None or not fitted.free or chdtrc(1, ((fitted.value - mean) / sd) ** 2) >= ALARM:
        return []
    words = f"Poisson's ratio {fitted.value:.3f} where {mean:g} ± {sd:g} is expected"
    mend = ("give poisson_ratio in [ground] of site.toml if the ground is known to be so", DIAGNOSE)
    return [Gate("ground", "failed", words, mend, fitted.value, mean, sd)]


def side_gates(result: FitResult) -> list[Gate]:
    """That the side of the road is open; nothing where it is known."""
    if not result.ambiguous_side:
        return []
    words = "the mirror route on the other side of the traffic is not ruled out"
    return [Gate("side of the road", "failed", words, ("survey one anchor, or traffic in a second lane",))]


def discrepancy_gates(problem: Problem) -> list[Gate]:
    """That the model holds a discrepancy model, which names no cause; nothing where it holds none."""
    names = [one.name for one in problem.effects if one.generic]
    if not names:
        return []
    are = "is a discrepancy model" if len(names) == 1 else "are discrepancy models"
    words = f"{', '.join(names)} {are}: fitted to what no known effect explains"
    return [Gate("named effects", "failed", words, ("find the cause: a discrepancy model makes no route better",))]
