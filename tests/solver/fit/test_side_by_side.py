"""The same scores, whether one process computes them or several; and what a task raises is raised here."""

import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import pytest
import torch

from solver.catalogue.catalogue import built_in
from solver.catalogue.trial_survey import trial_survey
from solver.criticism.scorer import Scorer, score_all
from solver.fit.forks import can_fork
from solver.fit.least_squares import solve
from solver.fit.map_fit import MapFit
from solver.fit.side_by_side import side_by_side

forks = pytest.mark.skipif(not can_fork(), reason="processes are forked on Linux without CUDA only")


@pytest.fixture
def two_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def interruptible():
    """Ctrl-C raises KeyboardInterrupt, which a shell's background jobs ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@forks
@pytest.mark.usefixtures("two_threads")
def test_tasks_run_in_other_processes_and_keep_their_order():
    advanced = []
    results = side_by_side(lambda task: (task, os.getpid()), range(5), advanced.append)
    assert [task for task, _ in results] == list(range(5))
    assert os.getpid() not in {process for _, process in results}
    assert advanced == [1] * 5


@forks
@pytest.mark.usefixtures("two_threads")
def test_what_a_task_raises_is_raised_here():
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda task: 1 / task, range(3))


@forks
@pytest.mark.usefixtures("two_threads")
def test_a_process_that_the_system_ends_is_reported_as_want_of_memory():
    with pytest.raises(MemoryError):
        side_by_side(lambda task: os.kill(os.getpid(), signal.SIGKILL), range(3))


@forks
@pytest.mark.usefixtures("two_threads")
def test_ctrl_c_ends_all_processes_at_once(capfd, tmp_path, interruptible):
    def task(number):
        (tmp_path / str(number)).touch()
        if number == 0:
            os.kill(os.getppid(), signal.SIGINT)
        time.sleep(0.2)

    with pytest.raises(KeyboardInterrupt):
        side_by_side(task, range(300))
    begun = len(list(tmp_path.iterdir()))
    assert begun < 300, "tasks that nobody waits for go on"
    time.sleep(0.5)
    assert len(list(tmp_path.iterdir())) == begun, "a process outlives the interruption"
    assert capfd.readouterr() == ("", "")


@forks
@pytest.mark.usefixtures("two_threads", "interruptible")
def test_ctrl_c_while_tasks_are_handed_out_cancels_them(tmp_path, monkeypatch):
    handed, submit = [], ProcessPoolExecutor.submit

    def submitted(pool, *task):
        handed.append(task)
        if len(handed) == 150:
            os.kill(os.getpid(), signal.SIGINT)
        return submit(pool, *task)

    def task(number):
        (tmp_path / str(number)).touch()
        time.sleep(0.05)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submitted)
    with pytest.raises(KeyboardInterrupt):
        side_by_side(task, range(300))
    assert len(list(tmp_path.iterdir())) < 100
    with pytest.raises(KeyboardInterrupt):  # as it was before
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1.0)


@forks
@pytest.mark.usefixtures("two_threads", "interruptible")
def test_ctrl_c_after_the_last_task_is_not_lost():
    advanced = []

    def advance(number):
        advanced.append(number)
        if len(advanced) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        side_by_side(lambda number: number, range(3), advance)
    assert advanced == [1] * 3
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@forks
def test_scores_are_those_of_one_process(two_threads):
    problem = trial_survey()[0].problem
    fit = MapFit(replace(problem, gauge_length=0.9 * problem.gauge_length, noise=problem.noise / 1000))
    scorer = Scorer(fit, solve(fit, fit.start()).state)
    effects = [built_in()[name] for name in ("gauge_length", "wheel_layout", "viscoelastic_lag", "track_jitter")]
    several = score_all(scorer, effects)
    torch.set_num_threads(1)
    alone = score_all(scorer, effects)
    assert several and [one.effect for one in several] == [one.effect for one in alone]
    for one, other in zip(several, alone, strict=True):
        assert one.fall == pytest.approx(other.fall, rel=1e-6, abs=1e-6)
        assert one.evidence == pytest.approx(other.evidence, rel=1e-6, abs=1e-6)
