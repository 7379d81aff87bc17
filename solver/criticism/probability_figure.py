"""How probable each explanation of a diagnosis is, in words and as bars."""

from collections.abc import Sequence
from dataclasses import replace

from matplotlib.figure import Figure

from solver.criticism.candidate import Candidate
from solver.criticism.explanations import Weighed, title_of_explanation
from solver.run.titles import probability_words
from vision.contract.drawing import beside, canvas, place
from vision.contract.figures import styled

#: Effects that are drawn at most.
KNOWN = 6
#: Kinds that name no effect.
REST = ("nothing", "unknown", "overlooked")
FIRST_COLOR, OTHER_COLOR, REST_COLOR = "#d55e00", "#0072b2", "#8a929a"


@styled
def probability_figure(explanations: Sequence[Weighed], listed: Sequence[Candidate]) -> Figure:
    """Bars of how probable each explanation is, with nothing and something unknown among them."""
    shown = explanations_shown(explanations)
    row = 26
    figure = canvas(1060, 60 + row * len(shown))
    axes = place(figure, "probability", 250, 6, 700, row * len(shown))
    for at, one in enumerate(shown):
        color = REST_COLOR if one.kind in REST else FIRST_COLOR if at == 0 else OTHER_COLOR
        axes.barh(at, 100 * one.probability, color=color, height=0.62)
        beside(axes, 100 * one.probability, at, probability_words(one.probability))
    titles = titles_of(listed)
    axes.set_yticks(range(len(shown)), [title_of_explanation(one, titles) for one in shown])
    axes.set(xlim=(0, 115), ylim=(len(shown) - 0.5, -0.5), xticks=(0, 25, 50, 75, 100))
    axes.set_xlabel("probability, %")
    return figure


def titles_of(listed: Sequence[Candidate]) -> dict[str, str]:
    """Titles of candidates by effect."""
    return {c.effect: c.title for c in listed}


def probability_line(explanations: Sequence[Weighed], listed: Sequence[Candidate]) -> str:
    """The probabilities in a line; what holds less than one in a thousand is left out, but never nothing."""
    shown = [one for one in explanations_shown(explanations) if one.probability >= 1e-3 or one.kind == "nothing"]
    return ", ".join(
        f"{title_of_explanation(one, titles_of(listed))} {probability_words(one.probability)}" for one in shown
    )


def explanations_shown(explanations: Sequence[Weighed]) -> list[Weighed]:
    """What is drawn, most probable first: the best, nothing, and all that is unknown as one."""
    unknown = [one for one in explanations if one.kind == "unknown"]
    rest = [one for one in explanations if one.kind != "unknown"]
    best = [one for one in rest if one.kind != "nothing"][:KNOWN]
    all_unknown = sum(one.probability for one in unknown)
    together = [replace(one, effects=one.effects[:1], probability=all_unknown) for one in unknown[:1]]
    nothing = [one for one in rest if one.kind == "nothing"]
    return sorted([*best, *nothing, *together], key=lambda one: -one.probability)
