"""A picture of what the matched filter saw of a survey that it refuses."""

from matplotlib.figure import Figure

from solver.start.alignment import Seen
from vision.contract.drawing import canvas, place
from vision.contract.figures import styled
from vision.contract.palette import BACKWARD, FORWARD

#: CSS pixels.
WIDTH, HEIGHT = 760, 420


@styled
def refused_figure(seen: Seen) -> Figure:
    """Where vehicles were said to be and which channel was loudest then; a fiber along the road shows as a line."""
    figure = canvas(WIDTH, HEIGHT + 110)
    axes = place(figure, "detections", 70, 50, WIDTH - 100, HEIGHT)
    for way, color, words in ((1, FORWARD, "toward +x"), (-1, BACKWARD, "toward -x")):
        mine = seen.speed * way > 0
        axes.plot(seen.x[mine], seen.channel[mine], ".", color=color, ms=4, alpha=0.6, label=f"vehicles {words}")
    axes.plot(seen.x[seen.inliers], seen.channel[seen.inliers], "o", mfc="none", mec="0.4", ms=6, label="on one line")
    axes.set_xlabel("x of the vehicle by the trajectories, m")
    axes.set_ylabel("channel that is loudest (counted from the first)")
    axes.set_title(seen.words.replace(", ", ",\n", 1), loc="left", fontsize=10)
    axes.legend(loc="best", frameon=False, fontsize=9)
    return figure
