"""A record that is scored part by part, against the same looked at as a whole."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from noisy_trials import noisy

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism import record_parts
from solver.criticism.quick_scores import best_of, planned, quick_scores, with_signals
from solver.criticism.score import Score
from solver.criticism.scorer import Scorer
from solver.fit.map_fit import MapFit
from solver.fit.state import State
from solver.fit.windowed import Windowed
from solver.load.load import Load
from solver.noise.law import NoiseLaw
from solver.signal_path import few
from solver.signal_path.sensitivities import Sensitivities
from solver.signal_path.signal_path import SignalPath
from solver.signal_path.traffic import Traffic

KNOWN = built_in()
#: Of each stage and scope; some of them mix samples, so that no part can be told by itself.
NAMES = (
    "clock_offset",
    "track_bend",
    "track_jitter",
    "dynamic_load",
    "braking",
    "poisson_gradient",
    "layered_ground",
    "rayleigh_wave",
    "generic_wave",
    "channel_coupling",
    "slack_spool",
    "gauge_length",
    "lowpass",
    "median_filter",
    "saturation",
    "generic_load",
    "generic_gain",
    "generic_neighbors",
)
#: Those of which no part can be told by itself, and that which the scorer has already.
AT_ONCE = ("lowpass", "median_filter", "saturation", "track_jitter")


def fitted() -> tuple[MapFit, State]:
    """The trial survey in noise that remembers, with gauges that are longer than thought."""
    fit = noisy(30, 6, KNOWN["gauge_length"], 0.05)
    law = NoiseLaw(0.5 ** np.arange(4.0), np.zeros(4), np.ones(1), np.zeros(1))
    return MapFit(replace(fit.problem, law=law)), trial_survey()[1]


def apart_in_time(fit: MapFit, state: State) -> tuple[MapFit, State]:
    """The same with the last half of the passes a minute later."""
    problem = fit.problem
    gap, count = round(60 * problem.sampling_rate), len(problem.passes) // 2
    last = max(int(one.rows[-1]) for one in problem.passes) + 1
    late = [replace(one, rows=one.rows + last + gap) for one in problem.passes[count:]]
    record = np.concatenate([problem.record, np.zeros((gap, problem.record.shape[1])), problem.record])
    passes = [*problem.passes[:count], *late]
    return MapFit(replace(problem, record=record, passes=passes, traffic=Traffic.of(passes))), state


@pytest.fixture(scope="module")
def whole() -> Scorer:
    fit, state = fitted()
    return Scorer(fit, state)


@pytest.fixture(scope="module")
def parted() -> Scorer:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record_parts, "WHOLE", 0.0)
        patch.setattr(record_parts, "EACH", 1.5e5)
        fit, state = fitted()
        return Scorer(fit, state)


def dense(windowed: Windowed) -> torch.Tensor:
    return torch.stack([windowed.times(one) for one in torch.eye(windowed.width, dtype=torch.float64)], 1)


def test_parts_follow_one_another_and_look_back_at_what_the_noise_remembers(parted: Scorer) -> None:
    *parts, last = parted.parts
    assert len(parts) > 2 and last.section is None
    samples = len(parted.fit.problem.traffic.samples)
    sections = [part.section for part in parts if part.section is not None]
    assert [part.first for part in parts] == [0, *(one.samples.stop for one in sections[:-1])]
    assert sections[-1].samples.stop == samples
    assert all(part.lead <= parted.fit.whiten.memory for part in parts) and any(part.lead for part in parts)


@pytest.mark.parametrize("name", NAMES)
def test_directions_are_those_of_the_whole(whole: Scorer, parted: Scorer, name: str) -> None:
    effect = KNOWN[name]
    shape = {p.name: p.grid[0] for p in effect.shapes}
    expected, counts = whole.columns(effect, shape, whole.fit.problem.extension([effect]))
    extension = parted.fit.problem.extension([effect])
    found, told = parted.columns(effect, shape, extension)
    assert told == counts
    size = float(dense(expected).abs().max())
    torch.testing.assert_close(dense(found), dense(expected), rtol=1e-9, atol=1e-11 * size)
    parts = [parted.columns(effect, shape, extension, part)[0] for part in parted.parts]
    total = sum((dense(one) for one in parts[1:]), dense(parts[0]))
    torch.testing.assert_close(total, dense(expected), rtol=1e-9, atol=1e-11 * size)
    assert (sum(bool(one.parts) for one in parts) > 1) == (name not in AT_ONCE)


def test_the_fit_s_own_derivatives_are_those_of_the_whole(whole: Scorer, parted: Scorer) -> None:
    expected = dense(whole.jacobian)
    torch.testing.assert_close(dense(parted.jacobian), expected, rtol=1e-9, atol=1e-11 * float(expected.abs().max()))
    torch.testing.assert_close(parted.residual, whole.residual)
    torch.testing.assert_close(parted.step, whole.step, rtol=1e-6, atol=1e-9)


def test_derivatives_of_all_vehicles_are_never_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of each gauge by each vehicle: of a long record they take more than all that is kept of it."""
    rows: list[int] = []
    found = SignalPath.by_gauges_and_loads

    def watched(path: SignalPath, load: Load, *others: Any) -> Sensitivities:
        rows.append(len(load.share))
        return found(path, load, *others)

    monkeypatch.setattr(record_parts, "WHOLE", 0.0)
    monkeypatch.setattr(record_parts, "EACH", 1.5e5)
    monkeypatch.setattr(SignalPath, "by_gauges_and_loads", watched)
    fit, state = fitted()
    scorer = Scorer(fit, state)
    quick_scores(scorer, [KNOWN["generic_load"], KNOWN["gauge_length"]])
    assert rows and max(rows) < 0.6 * len(fit.path.traffic.pass_index)


@pytest.mark.parametrize("name", ["lowpass", "median_filter", "saturation", "generic_delay"])
def test_what_mixes_samples_is_told_stretch_by_stretch(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Where nothing is heard for long enough that filters begin anew."""
    monkeypatch.setattr("solver.fit.problem.OFTEN", 1.0)  # else a filter in time sees more moments than are measured
    late = apart_in_time(*fitted())
    whole = Scorer(*late)
    monkeypatch.setattr(record_parts, "WHOLE", 0.0)
    monkeypatch.setattr(record_parts, "EACH", 1.5e5)
    parted, effect = Scorer(*late), KNOWN[name]
    shape, extension = {p.name: p.grid[0] for p in effect.shapes}, parted.fit.problem.extension([effect])
    expected = dense(whole.columns(effect, shape, whole.fit.problem.extension([effect]))[0])
    each = [(part.reach, parted.columns(effect, shape, extension, part)[0]) for part in parted.parts]
    assert [part.reach for part in parted.parts].count("stretch") == 2
    assert {reach for reach, one in each if one.norm > 0} == {"stretch"}
    total = sum(dense(one) for _, one in each)
    torch.testing.assert_close(total, expected, rtol=1e-9, atol=1e-11 * float(expected.abs().max()))


def test_quick_scores_are_those_of_the_whole(whole: Scorer, parted: Scorer) -> None:
    effects = [KNOWN[name] for name in NAMES]
    expected, found = (quick_scores(scorer, effects) for scorer in (whole, parted))
    assert [one.effect.name for one in found] == [one.effect.name for one in expected]
    for one, other in zip(found, expected, strict=True):
        assert one.evidence == pytest.approx(other.evidence, rel=1e-7, abs=1e-7)
        torch.testing.assert_close(parted.following(one), whole.following(other), rtol=1e-5, atol=1e-9)


def test_quick_scores_come_back_from_processes_of_their_own(whole: Scorer) -> None:
    """Effects are code, which is not sent: where there are two cores each scores a part of the catalogue."""
    effects = [KNOWN[name] for name in ("clock_offset", "gauge_length")]
    alone, before = quick_scores(whole, effects), torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        found = quick_scores(whole, effects)
    finally:
        torch.set_num_threads(before)
    assert [(one.effect, one.fall) for one in found] == [(one.effect, pytest.approx(one.fall)) for one in alone]


def test_signals_that_were_not_kept_are_made_anew(parted: Scorer) -> None:
    plans = [planned(parted, KNOWN[name]) for name in ("gauge_length", "lowpass", "generic_load")]
    found = best_of(parted, plans, lambda n: None)
    table = [Score(plan.effect, **one) for plan, one in zip(plans, found, strict=True) if one is not None]
    assert len(table) == 3 and all(one.signal is None for one in table)
    for bare, score in zip(table, with_signals(parted, table), strict=True):
        assert score.signal is not None
        crossed = parted.jacobian.transposed_times(score.signal)[:, 0]
        torch.testing.assert_close(crossed, bare.crossed, rtol=1e-7, atol=1e-7 * float(crossed.abs().max()))


def test_only_a_few_derivatives_are_held_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a fit's and of an effect's many numbers, at any length of the record."""
    largest: list[int] = []
    through = Windowed._through

    def watched(maps: torch.Tensor, *others: object) -> Windowed:
        largest.append(maps.numel())
        return through(maps, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(Windowed, "_through", watched)
    fit, state = fitted()
    cells = fit.data.numel()
    monkeypatch.setattr(few, "AT_ONCE", 4 * cells)
    scorer = Scorer(fit, state)
    effect = KNOWN["generic_load"]
    columns, counts = scorer.columns(effect, {}, fit.problem.extension([effect]))
    assert scorer.jacobian.width > 40 and sum(counts) == columns.width > 12
    assert max(largest) <= 4 * cells
    assert scorer.jacobian.extent < 0.7 * scorer.jacobian.width, "kept where they act"
