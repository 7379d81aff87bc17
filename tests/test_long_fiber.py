"""A fiber of 600 m along a curving road: sections, one global fit, what is said of it."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.long_fiber import LongSurvey, made, written
from solver.run.folder import read_run
from solver.run.locate import locate
from solver.run.run import Run
from solver.start.free_tracks import is_heard
from solver.start.joined_sections import joined, sides_of
from solver.start.sections import extent, heard, initialize_sections, sections_of, sought
from solver.survey.survey import Survey
from solver.trajectory.passes import smooth_passes
from solver.trajectory.vehicle_pass import Pass


@pytest.fixture(scope="module")
def survey() -> LongSurvey:
    return made(0.6, 6, 18.0, 3)


@pytest.fixture(scope="module")
def passes(survey: LongSurvey) -> list[Pass]:
    return smooth_passes(survey.trajectories, survey.record)


@pytest.fixture(scope="module")
def located(survey: LongSurvey, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return locate(Survey.read(written(survey, tmp_path_factory.mktemp("long") / "survey")))


def test_sections_unroll_the_road(passes: list[Pass]) -> None:
    assert extent(passes) > 600
    sections = sections_of(passes)
    assert len(sections) >= 2
    for section in sections:
        place = np.column_stack([np.linspace(-150, 150, 31), np.full(31, 4.5)])
        np.testing.assert_allclose(section.local(section.outward(place)), place, atol=0.02)
        for one in passes:
            part = section.cut(one)
            assert part is not None
            # The road bends by meters in a section; unrolled the lane is straight.
            assert np.ptp(part.position[:, 1]) < 1.5
            assert np.sign(part.speed) == np.sign(one.speed)


def test_a_section_is_sought_among_all_channels(survey: LongSurvey, passes: list[Pass]) -> None:
    section = sections_of(passes)[-1]
    near = heard([part for one in passes if (part := section.cut(one)) is not None])
    column, way = sought(survey.record, near)
    middle = section.outward(np.zeros((1, 2)))[0]
    beside = int(np.linalg.norm(survey.truth[:, :2] - middle, axis=1).argmin())
    assert way == 1 and abs(column - beside) < 12


def test_rough_route_lies_beside_the_fiber_on_its_side(survey: LongSurvey, passes: list[Pass]) -> None:
    found = initialize_sections(survey.record, passes)
    chosen, other, evidence = sides_of(found)
    channel, route = joined(found, chosen)
    off = np.linalg.norm(route[:, :2] - survey.truth[channel, :2], axis=1)
    mirrored = np.linalg.norm(joined(found, other)[1][:, :2] - survey.truth[channel, :2], axis=1)
    assert np.median(off) < 0.8 and np.median(mirrored) > 4
    assert evidence > 3 * len(found)
    assert len(channel) > 0.95 * len(survey.truth)


def test_one_global_fit_finds_it(survey: LongSurvey, located: Run) -> None:
    result = located.result
    here = np.isin(result.channel, np.arange(len(survey.truth)))
    error = result.route[here] - survey.truth[result.channel[here]]
    assert result.converged and not result.ambiguous_side
    assert here.sum() > 0.95 * len(survey.truth)
    assert np.linalg.norm(error, axis=1).mean() < 0.1
    assert np.linalg.norm(error, axis=1).max() < 0.3
    assert (np.abs(error) < 1.96 * result.sigma[here]).mean() > 0.8
    assert 0.95 < result.chi2_per_dof < 1.05
    assert 0.9 < located.facts["held_out_chi2_per_dof"] < 1.15
    assert sum(name.startswith("amplitude[") for name in result.parameters) > 6 * 8


def test_a_long_run_is_written_and_read(located: Run, tmp_path: Path) -> None:
    located.save(tmp_path / "run")
    run = read_run(tmp_path / "run")
    np.testing.assert_allclose(run.result.route, located.result.route)
    np.testing.assert_allclose(run.result.measured, located.result.measured, rtol=1e-5, atol=1e-12)
    assert run.facts["noise_floor"] == pytest.approx(1.0, abs=0.05)
    assert (tmp_path / "run" / "report.html").stat().st_size < 8e6


def test_vehicles_that_nobody_listed_are_heard_along_all_of_a_long_road(survey: LongSurvey, tmp_path: Path) -> None:
    """Each as one vehicle, though it is heard in section after section."""
    whole = Survey.read(written(survey, tmp_path / "survey"))
    assert whole.tracks is not None
    gone = ["1", "4"]
    some = whole.with_tracks(whole.tracks[~whole.tracks["track_id"].isin(gone)])
    run = locate(some, unlisted=True)
    heard_only = [one for one in run.passes if is_heard(one)]
    assert len(heard_only) == 2 and run.result.chi2_per_dof < 1.05
    for one, name in zip(heard_only, gone, strict=True):
        track = whole.tracks[whole.tracks["track_id"] == name]
        seconds = (track["time"].dt.tz_convert(None) - some.record.start).dt.total_seconds().to_numpy()
        time = some.record.time[one.rows]
        inside = (time > seconds[0]) & (time < seconds[-1])
        off = [np.interp(time[inside], seconds, track[axis]) - one.position[inside, i] for i, axis in enumerate("xy")]
        assert np.ptp(one.position[inside, 0]) > 550
        assert np.hypot(*off).mean() < 2.0
