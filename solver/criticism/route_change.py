"""How far the route moves with each candidate: what ignoring that would do to the route."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from solver.criticism.candidate import Candidate
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.run.ladder import MISFITS
from solver.run.run import Run
from solver.run.run_corridor import median_half
from solver.run.trust import Trust

if TYPE_CHECKING:
    from solver.criticism.bench import Bench
    from solver.criticism.finding import Diagnosis
    from solver.criticism.refit import Refit
    from solver.criticism.scorer import Scorer


def route_of(fit: MapFit, state: State, channel: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
    """Places [channel, 3] of some channels, m; of the fitted ones where none are given."""
    distance = fit.problem.distance if channel is None else fit.problem.distance_of(channel)
    place, _, _ = fit.prior.led(state, distance)
    at = place.clamp(fit.basis.start, fit.basis.stop).numpy()
    return np.asarray(fit.basis.along(state.coefficients.numpy(), at))


def moved_by(scorer: "Scorer", change: Tensor) -> NDArray[np.float64]:
    """How the route moves [channel, 3], m, with a change of all that was fitted [free]."""
    step = scorer.fit.mean.new_zeros(len(scorer.fit.mean))
    step[scorer.fit.free] = change
    after = scorer.state.moved(scorer.state.vector() + step)
    return route_of(scorer.fit, after) - route_of(scorer.fit, scorer.state)


def moves(bench: "Bench", name: str, tried: Mapping[str, "Refit"]) -> NDArray[np.float64] | None:
    """How the route moves [channel, 3], m, with an effect: as fitted in full, else as the score test predicts."""
    scorer = bench.scorer
    before = route_of(scorer.fit, scorer.state)
    if name in tried:
        return route_of(tried[name].fit, tried[name].solution.state) - before
    score = next((one for one in bench.table if one.effect.name == name), None)
    if score is None:
        return None
    return moved_by(scorer, scorer.following(score))


def moved(bench: "Bench", name: str, tried: Mapping[str, "Refit"]) -> float | None:
    """Largest way, m, that the route moves with an effect."""
    way = moves(bench, name, tried)
    return None if way is None or not np.isfinite(way).all() else float(np.linalg.norm(way, axis=1).max())


def with_moves(bench: "Bench", listed: Sequence[Candidate], tried: Mapping[str, "Refit"]) -> list[Candidate]:
    """Candidates with how far the route moves with each."""
    return [replace(one, route_change=moved(bench, one.effect, tried)) for one in listed]


def from_run(run: Run, diagnosis: "Diagnosis") -> "Diagnosis":
    """The diagnosis as the run bears it out.

    Route changes are from the run's own route, as the ladder will state them, where that is known: a diagnosis starts
    from a fit of its own, whose tracks may shift less. No model is adequate whose run leaves more than noise does, or
    lacks what moves its route beyond its corridor.
    """
    return borne_out(run, with_own_moves(run, diagnosis))


def borne_out(run: Run, diagnosis: "Diagnosis") -> "Diagnosis":
    """The diagnosis, inconclusive where it calls a model adequate that the run's own checks do not."""
    first = diagnosis.candidates[0] if diagnosis.candidates else None
    if diagnosis.verdict != "adequate":
        return diagnosis
    if first is not None and first.shows_small and (first.route_change or 0.0) > median_half(run.result):
        words = f"{diagnosis.words} But it moves the route by up to {first.route_change:.2f} m"
        return replace(diagnosis, verdict="inconclusive", words=words)
    failed = [one.words for one in Trust.stored(run.facts["trust"]).gates if one.failed and one.name in MISFITS]
    if failed:
        words = f"nothing in the catalogue explains what is left: {'; '.join(failed)}"
        return replace(diagnosis, verdict="inconclusive", words=words)
    return diagnosis


def with_own_moves(run: Run, diagnosis: "Diagnosis") -> "Diagnosis":
    """The diagnosis with route changes from the run's own route."""
    known = run.result.constrained
    if not diagnosis.fits or not known.any():
        return diagnosis
    channel, route = run.result.channel[known], run.result.route[known]

    def one(c: Candidate) -> Candidate:
        if c.effect not in diagnosis.fits:
            return c
        far = np.linalg.norm(route_of(*diagnosis.fits[c.effect], channel) - route, axis=1)
        return replace(c, route_change=float(far.max()))

    return replace(diagnosis, candidates=tuple(map(one, diagnosis.candidates)))
