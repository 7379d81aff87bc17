"""What counts as a dead channel, and that records, rough routes and criticism go by the same tests."""

from dataclasses import replace

import numpy as np

from solver.survey.das import DASRecord
from solver.survey.dead_channels import dead_channels, is_nearly_silent, repeating


def listened(record: DASRecord, **changes: np.ndarray) -> DASRecord:
    """The record with other numbers."""
    return replace(record, **changes)


def test_channels_that_repeat_a_number_most_of_the_time_are_dead_and_gaps_do_not_count(survey) -> None:
    rate = np.random.default_rng(0).normal(size=survey.record.strain_rate.shape)
    rate[:300, 30] = 0.5
    rate[:370, 31] = 0.5
    rate[:, 40] = 7.0
    rate[40:340] = np.nan
    record = listened(survey.record, strain_rate=rate)
    # Of the 100 rows that are left, channel 30 repeats a number in 40 and channel 31 in 70.
    assert repeating(record, np.arange(20, 50)).tolist() == [31, 40]


def test_only_what_surely_records_less_than_a_third_is_dead() -> None:
    gain, usual = np.array([0.29, 0.31, -0.29, 0.1, 0.1]), np.array([1.0, 1.0, 1.0, 0.3, 1.0])
    sigma = np.array([0.01, 0.01, 0.01, 0.01, np.inf])
    assert is_nearly_silent(gain, sigma, usual).tolist() == [True, False, True, False, False]
    assert is_nearly_silent(gain * usual, sigma * usual, usual).tolist()[:4] == [True, False, True, True]


def test_a_muffled_channel_among_others_is_found_wherever_lots_are_cut(survey, monkeypatch) -> None:
    passing = np.exp(-((np.arange(400)[:, None] - 2 * np.arange(150)) ** 2) / 200)
    rate = passing + 0.01 * np.random.default_rng(0).normal(size=passing.shape)
    rate[:, [60, 81]] -= 0.95 * passing[:, [60, 81]]
    record = listened(survey.record, strain_rate=rate)
    for together in (400, 20, 7):
        monkeypatch.setattr("solver.survey.dead_channels.TOGETHER", together)
        assert dead_channels(record, np.arange(50, 111)).tolist() == [60, 81]
