"""The finding on one effect, or on one fault of the survey."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from solver.catalogue.catalogue import FAULTS
from solver.catalogue.plain_words import Told
from solver.criticism.fault import Fault
from solver.criticism.marginal import fault_evidence
from solver.criticism.policy import POLICY
from solver.criticism.refit import Refit
from solver.criticism.score import Score
from solver.effect import Effect, Parameter


@dataclass(frozen=True)
class Candidate:
    """The finding on one effect.

    Parameters
    ----------
    effect, stage : as in the catalogue
    generic : a discrepancy model for the unknown
    verdict : present, excluded, negligible or inconclusive
    delta_chi2 : fall of the misfit with it: of the full fit where there was one, else as predicted
    predicted : fall that the score test predicted
    evidence : ln of the Bayes factor
    p_value : of the score test, for the shapes tried
    estimate, sigma, unit : of its first number, or of many alike: their root mean square (mean, where one number is
        told for all passes) and the median of their sigmas, without those that leave no trace in the survey
    numbers : how many it adds
    shape : values of its shape parameters
    retained_share : of its signal that the fit leaves visible
    detectable_size : smallest size (5 sigma) that this survey would have shown
    confounded_with : names it cannot be told apart from here
    held_out_gain : fall of the held-out chi2 per degree of freedom; None where it was not tried, or too few passes show
        the effect
    refitted : whether it was fitted in full
    families : of effects that surveys often cannot tell apart, those it belongs to
    route_change : largest way, m, that it moves the route where it is ignored; None where that was not computed
    probability : that it is missing; of a discrepancy model, that something unknown acts that is most like it
    told : the same for people, see `solver.catalogue.plain_words`; None until a diagnosis is whole
    """

    effect: str
    stage: str
    generic: bool
    verdict: str
    delta_chi2: float
    predicted: float
    evidence: float
    p_value: float
    estimate: float
    sigma: float
    unit: str
    numbers: int
    shape: Mapping[str, float]
    retained_share: float
    detectable_size: float
    confounded_with: tuple[str, ...] = ()
    held_out_gain: float | None = None
    refitted: bool = False
    families: tuple[str, ...] = ()
    route_change: float | None = None
    probability: float = 0.0
    told: Told | None = None

    @property
    def title(self) -> str:
        """Two or three plain words; its name where it has none."""
        return self.effect if self.told is None else self.told.title

    @property
    def shows_small(self) -> bool:
        """Whether it is there, more probably than not, at a size that does not matter by itself."""
        return self.verdict == "negligible" and self.probability > 0.5


def fault_candidate(fault: Fault, variance: float) -> Candidate:
    """The finding on a fault of the survey, where noise counts as of some variance."""
    strength = fault_evidence(fault.fall / variance, fault.freedom, fault.trials)
    least = POLICY.negligible * FAULTS[fault.name].plausible[0]
    found = strength > POLICY.found and (fault.name != "unseen_vehicle" or fault.estimate > max(5 * fault.sigma, least))
    return Candidate(
        effect=fault.name,
        stage=fault.stage,
        generic=False,
        verdict="present" if found else "excluded",
        delta_chi2=fault.fall,
        predicted=fault.fall,
        evidence=strength,
        p_value=min(1.0, fault.trials * float(chdtrc(fault.freedom, max(fault.fall, 0.0)))),
        estimate=fault.estimate,
        sigma=fault.sigma,
        unit=fault.unit,
        numbers=fault.freedom,
        shape={},
        retained_share=1.0,
        detectable_size=fault.detectable,
    )


def idle_candidate(effect: Effect) -> Candidate:
    """The finding on an effect that has nothing to act on, as one of trucks where none drives."""
    parameter = effect.amplitudes[0]
    return Candidate(
        effect=effect.name,
        stage=effect.stage,
        generic=effect.generic,
        verdict="inconclusive",
        delta_chi2=0.0,
        predicted=0.0,
        evidence=0.0,
        p_value=1.0,
        estimate=parameter.null,
        sigma=float("inf"),
        unit=parameter.unit,
        numbers=0,
        shape={},
        retained_share=0.0,
        detectable_size=float("inf"),
        families=effect.families,
    )


def first_kind(score: Score) -> tuple[Parameter, NDArray[np.bool_]]:
    """The first parameter with a trace in the survey, and which numbers [number] with a trace are of its kind."""
    heard = np.isfinite(score.sigma)
    owners = [p for p, count in zip(score.effect.amplitudes, score.counts, strict=True) for _ in range(count)]
    first = owners[int(heard.argmax())]
    return first, heard & [(p.unit, p.plausible) == (first.unit, first.plausible) for p in owners]


def shows_from(parameter: Parameter, sigma: float, variance: float) -> float:
    """Smallest size that shows, at five sigmas of a noise of some variance; infinite where no size would.

    No size would where the fit absorbs an effect entirely, nor where only one beyond the effect's bounds did.

    >>> gain = Parameter("log_gain", "1", 0.3, lower=-3, upper=3)
    >>> shows_from(gain, 0.02, 4.0), shows_from(gain, 0.7, 1.0)
    (0.2, inf)
    """
    size = 5 * sigma * variance**0.5
    farthest = max(parameter.upper - parameter.null, parameter.null - parameter.lower)
    return size if sigma < 1e3 * parameter.plausible and size <= farthest else float("inf")


def score_candidate(score: Score, tried: Refit | None) -> Candidate:
    """The finding on an effect by its score and, where there was one, its full fit."""
    parameter, alike = first_kind(score)
    numbers = (score.estimate if tried is None else tried.estimate)[alike]
    one = score.freedom == 1 or len(numbers) == 1
    estimate = float(numbers.mean() if one else np.sqrt(np.mean(numbers**2)))
    # A full fit gives the sigma; the score gives the size that would have shown.
    predicted = float(np.median(score.sigma[alike]))
    sigma = predicted if tried is None else float(np.median(tried.sigma[alike]))
    strength = score.evidence if tried is None else tried.evidence
    detectable = shows_from(parameter, predicted, score.variance)
    if strength > POLICY.found and abs(estimate) < POLICY.negligible * parameter.plausible:
        verdict = "negligible"
    elif strength > POLICY.found:
        verdict = "present"
    elif detectable > 3 * parameter.plausible:
        verdict = "inconclusive"
    elif detectable < 0.5 * parameter.plausible:
        verdict = "excluded"
    else:
        verdict = "negligible"
    return Candidate(
        effect=score.effect.name,
        stage=score.effect.stage,
        generic=score.effect.generic,
        verdict=verdict,
        delta_chi2=score.fall if tried is None else tried.fall,
        predicted=score.fall,
        evidence=strength,
        p_value=min(1.0, score.trials * float(chdtrc(score.freedom, max(score.fall, 0.0)))),
        estimate=estimate,
        sigma=sigma,
        unit=parameter.unit,
        numbers=score.freedom,
        shape=score.shape if tried is None else tried.shape,
        retained_share=score.retained,
        detectable_size=detectable,
        refitted=tried is not None,
        families=score.effect.families,
    )
