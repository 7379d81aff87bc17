"""A plugin is tried in a process of its own and runs under guard: it may print, hang, end, or change what is shared."""

import builtins
import json
import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import roadfiber.command
from solver.catalogue import proof
from solver.catalogue.guard import aside, guarded, untouched
from solver.catalogue.plugins import catalogue
from solver.catalogue.trial_survey import Trial, trial_survey
from solver.catalogue.verify import verify
from solver.effect import Effect, Parameter, effect
from vision.contract import InputError

SHARE = Parameter("share", "1", 0.1)

PLUGIN = """
import os, sys
from dataclasses import replace
import numpy
import torch
from solver.effect import Parameter, effect

{at_import}

@effect("mine", "cable", [Parameter("share", "1", 0.1)], physics="Mine.", source="Mine.")
def mine(cable, p, survey):
    {in_function}
    return replace(cable, gain=cable.gain * (1 + p["share"]))
"""


@pytest.fixture
def plugin(tmp_path):
    def written(at_import="", in_function=""):
        path = tmp_path / "mine.py"
        path.write_text(PLUGIN.format(at_import=at_import, in_function=in_function))
        return path

    return written


def grip(change) -> Effect:
    """An effect of the cable that does something more."""

    def function(cable, p, survey):
        change(cable, p, survey)
        return replace(cable, gain=cable.gain * (1 + p["share"]))

    return effect("mine", "cable", [SHARE], physics="Mine.", source="Mine.")(function)


@pytest.mark.parametrize(
    ("at_import", "in_function", "words"),
    [
        ("sys.exit(0)", "", r"^--plugin .*mine\.py: ends the program \(sys\.exit\); raise an exception instead"),
        ("", "sys.exit(3)", "^effect mine: its function fails with SystemExit: 3;"),
        ("os._exit(0)", "", r"^--plugin .*mine\.py: ends the process that runs it \(exit status 0\)"),
        ("", "os.kill(os.getpid(), 9)", r"^--plugin .*mine\.py: ends the process that runs it \(signal 9\)"),
        ("torch.set_default_dtype(torch.float32 if 0 else torch.float64)", "", "changes torch's default dtype, which"),
        ("", "torch.manual_seed(0)", "^effect mine: its function changes torch's random numbers, which"),
        ("numpy.seterr(all='ignore')", "", "mine.py: its import changes numpy's handling of floating-point errors"),
        ("import builtins; builtins.sum = max", "", "mine.py: its import changes builtins.sum, which all of roadfiber"),
        ("", "torch.Tensor.exp = torch.Tensor.sin", "^effect mine: its function changes Tensor.exp, which"),
    ],
)
def test_what_a_plugin_must_not_do_is_reported_in_a_line(plugin, at_import, in_function, words):
    was = torch.get_default_dtype(), np.geterr(), builtins.sum
    with pytest.raises(InputError, match=words) as caught:
        catalogue([plugin(at_import, in_function)])
    assert "\n" not in str(caught.value)
    assert (torch.get_default_dtype(), np.geterr(), builtins.sum) == was


def test_what_pytorch_loads_late_is_not_the_plugins_doing(plugin, monkeypatch):
    """Its compiler puts functions of its own into torch; a process that is not forked has not loaded it before."""
    monkeypatch.setattr(proof, "can_fork", lambda: False)
    assert "mine" in catalogue([plugin("import torch._dynamo")])


@pytest.mark.parametrize(("place", "line"), [("at_import", 8), ("in_function", 12)])
def test_an_endless_loop_is_ended_and_its_line_told(plugin, monkeypatch, place, line):
    proof.warm()  # with the true `verify`: alone, this test is the first to call it
    monkeypatch.setattr(proof, "LIMIT", 0.3)
    monkeypatch.setattr(proof, "verify", lambda one: one.change(None, {}, None))
    with pytest.raises(InputError, match=rf"mine\.py: not done after 0\.3 s \(line {line}\); see that every loop ends"):
        catalogue([plugin(**{place: "while True: pass"})])


def test_what_a_plugin_prints_is_kept_out_of_json(plugin, capfd):
    path = plugin("print('one'); os.system('echo two')", "print('three'); os.write(1, b'four')")
    roadfiber.command.app(["effects", "mine", "--json", "--plugin", str(path)], standalone_mode=False)
    out, err = capfd.readouterr()
    assert json.loads(out)["name"] == "mine"
    assert "one" in err and "two" in err
    one = catalogue([path])["mine"]
    trial = Trial(one, *trial_survey())
    capfd.readouterr()
    trial.map(trial.numbers())
    out, err = capfd.readouterr()
    assert out == "" and "three" in err and "four" in err


def test_an_effect_that_ends_or_changes_what_is_shared_later_is_reported_where_it_runs():
    with pytest.raises(InputError, match="effect mine: its function ends the program"):
        guarded(grip(lambda *given: exit_now())).change(None, {}, None)
    with pytest.raises(InputError, match="effect mine: its function changes whether torch computes derivatives"):
        try:
            guarded(grip(lambda *given: torch.set_grad_enabled(False))).change(*given())
        finally:
            torch.set_grad_enabled(True)


def exit_now():
    raise SystemExit(1)


def given():
    trial = Trial(grip(lambda *given: None), *trial_survey())
    return trial.given(), trial.extension.local(trial.numbers())["mine"], trial.around


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda cable, p, survey: p["share"].mul_(1.0), r"values\['share'\]"),
        (lambda cable, p, survey: survey.middle.add_(0.0), "survey.middle"),
        (lambda cable, p, survey: cable.counted.numpy().__iadd__(1.0), "counted"),
        (lambda cable, p, survey: object.__setattr__(cable, "vertical", 2.0), "vertical"),
    ],
)
def test_any_change_in_place_is_named(change, part):
    around = trial_survey()[0].problem.extension([grip(change)]).surroundings
    kept = around.middle.clone(), around.distance.clone()
    try:
        with pytest.raises(InputError, match=f"effect mine: changes {part} in place"):
            verify(grip(change))
    finally:
        around.middle[:], around.distance[:] = kept


def test_threads_share_one_guard(capfd):
    """One that leaves before another must not send what comes after to standard error for good."""
    first, second = threading.Event(), threading.Event()

    def outlast():
        with aside():
            first.set()
            second.wait(5)
            print("aside")

    other = threading.Thread(target=outlast)
    with aside():
        other.start()
        first.wait(5)
    second.set()
    other.join()
    print("result")
    os.write(1, b"below\n")
    out, err = capfd.readouterr()
    assert set(out.split()) == {"result", "below"} and err.split() == ["aside"]


def test_what_is_shared_and_stays_is_not_a_fault():
    with untouched("nobody"):
        torch.zeros(2).exp_()


GOES_ON = """
import subprocess, threading, time
children = [subprocess.Popen(["sleep", "600"], start_new_session=alone) for alone in (False, True)]
with open({name!r}, "w") as note:
    note.write(" ".join(str(child.pid) for child in children))
threading.Thread(target=time.sleep, args=(600,)).start()
raise ValueError("no more")
"""


def test_nothing_of_a_plugin_goes_on_after_its_trial(plugin, tmp_path):
    """Neither a thread, which the trial would wait for, nor a process of its own, nor one of another group."""
    with pytest.raises(InputError, match="no more"):
        catalogue([plugin(GOES_ON.format(name=str(tmp_path / "child.txt")))])
    for child in (tmp_path / "child.txt").read_text().split():
        status = Path("/proc") / child / "status"
        assert not status.exists() or "State:\tZ" in status.read_text()
