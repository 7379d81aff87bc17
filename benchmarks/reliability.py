"""Whether a diagnosis is right as often as its probabilities say, and whether corridors hold what they say.

    python -m benchmarks.reliability --first 5000 --trials 200 --out reliability.jsonl   # diagnose, a line each
    python -m benchmarks.reliability --table reliability.jsonl --plot docs/images/reliability.png

Each seed draws a survey: something hidden (or nothing, or what no catalogue has), as large as is plausible or less
than half of that, 4 to 12 passes, 5 to 25 dB, colored or street noise, a view of 40 to 60 m, a fiber as it is laid in
ducts or, one of six, that winds (in the figures of docs/mathematics/criticism.md all wind: their seeds were other
streets). It is located with and without what is hidden: what that adds to the misfit says whether it shows. Several
runs may fill one file; they leave out the seeds that it has.
"""

import argparse
import json
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from benchmarks.blind import FAIR, GEOMETRY, UNKNOWN, amount, surveyed
from benchmarks.judged_probabilities import judged, report, said
from solver.simulator import Scenario
from vision.contract import InputError

if TYPE_CHECKING:
    from solver.criticism.finding import Diagnosis
    from solver.criticism.growth import Grown
    from solver.effect import Effect
    from solver.fit.map_fit import MapFit
    from solver.fit.state import State
    from solver.run.run import Run

    #: A fit, where it ended, and its chi2 per degree of freedom.
    Ended = tuple[MapFit, State, float]

KINDS = {"null": 0.3, "one": 0.4, "two": 0.05, "unknown": 0.2, "geometry": 0.05}
#: Share of streets whose fiber winds; others are as they are built.
WINDING = 1 / 6
#: Sizes in proportion to what is drawn out of the plausible range.
SCALES = (1.0, 0.4)
#: Hidden effects that a smaller number does not make smaller.
AS_DRAWN = ("wheel_layout", "long_vehicle", "lowpass", "saturation", "fk_filter", "median_filter")
#: What changes the noise as well, so that misfits with and without it do not compare.
IN_NOISE = "unknown_equalized"


def draw(seed: int, wanted: str | None = None) -> tuple[str, Scenario]:
    """Kind and scenario of a seed, of a kind that is wanted or as chance has it."""
    rng = np.random.default_rng([seed, zlib.crc32(b"reliability")])
    drawn = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    kind = wanted or drawn
    pool: Sequence[str] = {"null": (), "unknown": UNKNOWN, "geometry": GEOMETRY}.get(kind, FAIR)
    names = [str(name) for name in rng.choice(pool, size=1 + (kind == "two"), replace=False)] if pool else []
    return kind, laid(drawn_survey(seed, kind, names, rng), rng)


def laid(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario with its fiber as it is laid in ducts, or one of a few that winds."""
    return replace(scenario, laid="winding" if rng.uniform() < WINDING else "as-built")


def drawn_survey(seed: int, kind: str, names: Sequence[str], rng: np.random.Generator) -> Scenario:
    """A scenario of a kind, with effects of some names hidden."""
    scale = float(rng.choice(SCALES))
    return Scenario(
        name=f"{kind}-{seed}",
        seed=seed,
        passes=int(rng.integers(4, 13)),
        snr_db=float(rng.uniform(5, 25)),
        noise=str(rng.choice(["colored", "street"])),
        view=(0.0, float(rng.uniform(40, 60))),
        effects={name: (1.0 if name in AS_DRAWN else scale) * amount(name, rng) for name in names},
    )


def known_to(finding: "Diagnosis") -> list[str]:
    """What a diagnosis names, with what it does not tell it from; [] where it names nothing."""
    first = finding.candidates[0] if finding.verdict == "missing-effect" else None
    return [] if first is None else [first.effect, *first.confounded_with]


def fitted(run: "Run") -> "tuple[MapFit, State]":
    """The fit of a run, where it ended."""
    from solver.fit.map_fit import MapFit

    fit = MapFit(run.problem)
    return fit, fit.state_of(torch.from_numpy(run.result.vector))


def rise(located: "Ended", without: "Ended", samples: int) -> float:
    """Misfit that something hidden adds to a fit, in variances that the noise counts as.

    What a fit pays to its priors counts, as for tracks that it shifts; what slow errors of the tracks explain as well,
    as large as these say, does not show.

    Parameters
    ----------
    located, without : fits with it in the record, and without
    samples : of both, as other channels may be fitted where nothing is hidden
    """
    from solver.criticism.directions import Directions
    from solver.criticism.slow_errors import slow_evidence

    paid = [chi2 * samples + float(fit.prior.total(state)) for fit, state, chi2 in (located, without)]
    at, before = (Directions(fit, state) for fit, state, _ in (located, without))
    slow = slow_evidence(at, at.variance) - slow_evidence(before, at.variance)
    return (paid[0] - paid[1]) / at.variance - 2 * max(slow, 0.0)


def beyond_fit(located: "Run", without: "Run") -> float:
    """What a fit leaves of its record's difference from another one, chi2 in variances that the noise counts as."""
    from solver.criticism.directions import Directions

    directions = Directions(*fitted(located))
    change = torch.as_tensor(located.problem.strain_rate - without.problem.strain_rate)
    left = directions.project([directions.whitened(change[None])])[0]
    return float(left.information) / directions.variance


def beside(scenario: Scenario, both: "Grown", samples: int, named: str, first: str) -> float:
    """Misfit that the second of two hidden effects adds once the first is in the model, in variances of the noise.

    Parameters
    ----------
    both : the fit with the first in the model, of so many samples of the record that holds both
    named, first : the first in the catalogue, and in the simulator
    """
    from solver.catalogue.catalogue import built_in
    from solver.criticism.growth import grow

    _, alone, _ = surveyed(replace(scenario, effects={first: scenario.effects[first]}))
    ends = both, grow(*fitted(alone), named, built_in(), None)
    return rise(*((end.fit, end.solution.state, end.result(0.0).chi2_per_dof) for end in ends), samples)


def added(scenario: Scenario, located: "Run") -> float:
    """Misfit that all hidden effects add to a fit without them, in variances of the noise."""
    if not scenario.effects:
        return 0.0
    _, without, _ = surveyed(replace(scenario, effects={}))
    if IN_NOISE in scenario.effects:
        return beyond_fit(located, without)
    ends = ((*fitted(run), run.result.chi2_per_dof) for run in (located, without))
    return rise(*ends, located.problem.strain_rate.numel())


def looked_again(
    scenario: Scenario, located: "Run", found: "Diagnosis", effects: "Sequence[Effect]"
) -> tuple[float | None, list[str]]:
    """Misfit that the second of two hidden effects adds, and what is named, once the first is dealt with.

    What was named rightly is put into the model; but of a filter of the maker, which the noise alone tells, the record
    before it is diagnosed, as the verdict advises. Where the first was not named, what the second adds is told beside
    the one that explains more, and nothing is named; None where a fault of the survey is one of the two.
    """
    from solver.catalogue.catalogue import built_in
    from solver.criticism.diagnosis import diagnose
    from solver.criticism.growth import grow
    from solver.criticism.refit import as_located

    named = known_to(found)
    first = next((name for name in scenario.effects if name in said(named[:1])), None)
    if first is None:
        if any(name not in built_in() for name in scenario.effects):
            return None, []
        grown = {name: grow(*fitted(located), name, built_in(), None) for name in scenario.effects}
        most = min(grown, key=lambda name: grown[name].result(0.0).chi2_per_dof)
        return beside(scenario, grown[most], located.problem.strain_rate.numel(), most, most), []
    if named[0] not in found.fits:
        rest = replace(scenario, effects={name: size for name, size in scenario.effects.items() if name != first})
        _, before, _ = surveyed(rest)
        return added(rest, before), known_to(diagnose(before.problem, fitted(before)[1], effects=effects))
    both = grow(*fitted(located), named[0], built_in(), None)
    second = beside(scenario, both, located.problem.strain_rate.numel(), named[0], first)
    fit, state = found.fits[named[0]]
    return second, known_to(diagnose(as_located(fit.problem), state, effects=effects))


def tried(seed: int, wanted: str | None = None) -> dict[str, Any]:
    """Locate and diagnose one survey: explanations, verdict, and what both corridors hold of the true route.

    Of two effects the one that is named rightly is dealt with, and what is left is diagnosed again.
    """
    from solver.catalogue.catalogue import built_in
    from solver.criticism.diagnosis import diagnose
    from solver.run.geojson import half_width, normals

    kind, scenario = draw(seed, wanted)
    survey, located, _ = surveyed(scenario)
    misfit, result = added(scenario, located), located.result
    begun, (_, state) = time.process_time(), fitted(located)
    effects = list(built_in().values())
    found = diagnose(located.problem, state, effects=effects)
    seconds = time.process_time() - begun
    second, then = looked_again(scenario, located, found, effects) if kind == "two" else (None, [])
    facts = {
        "seed": seed,
        "kind": kind,
        "hidden": dict(scenario.effects),
        "misfit": misfit,
        "misfit of the second": second,
        "passes": scenario.passes,
        "snr_db": scenario.snr_db,
        "verdict": found.verdict,
        "named": known_to(found),
        "then": then,
        "stage": found.candidates[0].stage if found.candidates else "",
        "explanations": [vars(one) for one in found.explanations],
        "cpu seconds": seconds,
    }
    if not result.constrained.any():
        return facts
    channel = result.channel[result.constrained]
    covariance, route = result.covariance[result.constrained], result.route[result.constrained]
    off = np.abs(((route - survey.route[channel])[:, :2] * normals(route)).sum(1))
    wide = covariance if found.corridor is None else covariance + found.corridor.at(channel)
    for name, one in (("plain", covariance), ("considered", wide)):
        half = half_width(route, one)
        facts |= {f"inside {name}": float((off <= half).mean()), f"half {name}": float(np.median(half))}
    return facts | {"error": float(off.max())}


def main() -> None:
    """Run trials, or read them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--kind", choices=list(KINDS), help="all surveys of one kind")
    parser.add_argument("--out", type=Path, default=Path("reliability.jsonl"))
    parser.add_argument("--table", type=Path, help="print what such a file holds, and no more")
    parser.add_argument("--plot", type=Path, help="with --table: draw the diagram there")
    options = parser.parse_args()
    path = options.table or options.out
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
    if options.table:
        report(known, options.plot)
        return
    done = {row["seed"] for row in known}
    for seed in range(options.first, options.first + options.trials):
        if seed in done:
            continue
        try:
            row = tried(seed, options.kind)
        except InputError as error:
            # Few light vehicles in much noise: there is no route to judge.
            print(seed, f"refused: {error}", flush=True)
            continue
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        best = [(one["effects"], one["stage"], round(one["probability"], 3)) for one in row["explanations"][:2]]
        print(seed, row["kind"], row["hidden"], row["verdict"], best, judged(row), flush=True)


if __name__ == "__main__":
    main()
