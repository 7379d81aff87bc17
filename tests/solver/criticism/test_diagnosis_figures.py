"""Pictures of a diagnosis: what stands side by side can be compared by eye."""

from dataclasses import replace

import numpy as np
import pytest

from solver.criticism.diagnosis_figures import BeforeAfter, corridor_figure
from solver.run.run import run_of


@pytest.mark.parametrize("turn", [0, 30])
def test_before_and_after_have_one_frame_and_one_scale(survey, turn: int) -> None:
    """Where one of two routes follows the road and the other turns, each was drawn in a frame of its own."""
    before = run_of(survey.result, **survey.arguments)
    moved = before.result.route + np.array([1.5, 0.4, 0.0])
    moved[:turn, :2] = moved[turn, :2] + np.outer(np.arange(turn)[::-1] + 1, (0.0, -1.0))
    after = replace(before, result=replace(before.result, route=moved))
    figure = corridor_figure(BeforeAfter(before, after, before.passes[0]))
    for row in ("Sideways", "Depth"):
        left, right = (next(one for one in figure.axes if one.get_label() == f"{row} {at}") for at in (0, 1))
        assert left.get_xlim() == right.get_xlim() and left.get_ylim() == right.get_ylim()
        assert left.get_ylabel() == right.get_ylabel()
    drawn = [next(one for one in figure.axes if one.get_label() == f"Sideways {at}").lines for at in (0, 1)]
    fibers = [max(lines, key=lambda line: np.ptp(line.get_xdata()) * (line.get_linestyle() == "-")) for lines in drawn]
    where = 95.0 if turn else 45.0  # along the fiber, along x
    there = [np.interp(where, *line.get_xydata().T) for line in fibers]
    assert there[1] - there[0] == pytest.approx(0.4, abs=0.08), "the move is seen as it is"
