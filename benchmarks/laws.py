"""Laws of the ground summed over gauges in one pass of machine code, against the same laws point by point.

    python benchmarks/laws.py --rows 600

Prints for each law the CPU time per gauge point and wheel either way and their ratio, and that of a pass with all
derivatives where a law has one. All run in one process, one after the other.
"""

import argparse
import time
from collections.abc import Callable

import pandas as pd
import torch
from torch import Tensor

from solver.catalogue.bells import Belled
from solver.catalogue.ground_discrepancies import SCALES
from solver.ground.gibson import stiffening
from solver.ground.ground import Ground
from solver.ground.ground_law import Law
from solver.ground.layered import layered
from solver.ground.moving import Moving
from solver.ground.one_pass import law_response
from solver.signal_path.ground_motion import offsets

CHANNELS, POINTS, WHEELS = 100, 6, 4
#: Rows that are computed together point by point: their tensors stay in the processor's cache.
TOGETHER = 28


def number(value: float) -> Tensor:
    """A number in double precision."""
    return torch.tensor(value, dtype=torch.float64)


def laws() -> dict[str, Law]:
    """Laws with numbers of plausible size."""
    bells = [[number(0.1)] * len(SCALES)] * 3
    tables = {"layered": layered(number(1.0), number(2.0)), "stiffening": stiffening(number(0.5))}
    return tables | {"moving": Moving(number(1e-4)), "unknown response": Belled(None, SCALES, *bells)}


def drawn(rows: int) -> tuple[Tensor, ...]:
    """Gauges within 100 m of wheels; Poisson's ratio at each point."""
    random = torch.Generator().manual_seed(1)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    point = torch.cat([100 * uniform(CHANNELS, POINTS, 2), 0.5 + uniform(CHANNELS, POINTS, 1)], -1)
    loads = 100 * uniform(rows, 1, WHEELS, 2), uniform(rows, 1, WHEELS), 20 * uniform(rows, 1, 2)
    return point, uniform(CHANNELS, POINTS, 3) - 0.5, *loads, number(0.3)


def by_points(law: Law, given: tuple[Tensor, ...]) -> Tensor:
    """Sums [row, channel] by way of the motion of every point under every wheel."""
    point, weight, place, share, velocity, ratio = given
    found = []
    for first in range(0, len(place), TOGETHER):
        rows = slice(first, first + TOGETHER)
        offset = offsets(point, place[rows, :, None])
        moved = Ground(response=law).displacement_rate(offset, velocity[rows, :, None, None], ratio)
        found.append((weight * (share[rows, :, None, :, None] * moved).sum(-2)).sum((-1, -2)))
    return torch.cat(found)


def seconds(work: Callable[[], object]) -> float:
    """CPU seconds, the best of three."""
    work()
    taken = []
    for _ in range(3):
        begun = time.process_time()
        work()
        taken.append(time.process_time() - begun)
    return min(taken)


def with_derivatives(law: Law, given: tuple[Tensor, ...]) -> Tensor:
    """Derivatives of the sums by the points, each row, channel and point with a ratio of its own."""
    point, *others, ratio = given
    rows = len(given[2])
    leaf = point.expand(rows, *point.shape).requires_grad_()
    found = law_response(law, leaf, *others, ratio.expand(rows, CHANNELS, POINTS))
    assert found is not None
    return torch.autograd.grad(found.sum(), leaf)[0]


def measured(law: Law, given: tuple[Tensor, ...]) -> dict[str, float]:
    """Nanoseconds for each gauge point and wheel, point by point and in one pass, and with derivatives."""
    plain, at_once = seconds(lambda: by_points(law, given)), seconds(lambda: law_response(law, *given))
    found = {"points, ns": plain, "one pass, ns": at_once}
    if law.has_pass(derivatives=True, uniform=True):
        found["with derivatives, ns"] = seconds(lambda: with_derivatives(law, given))
    pairs = given[2][..., 0].numel() * CHANNELS * POINTS
    return {name: 1e9 * value / pairs for name, value in found.items()} | {"ratio": plain / at_once}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=600, help="vehicles times samples")
    given = drawn(parser.parse_args().rows)
    torch.set_num_threads(1)
    table = {name: measured(law, given) for name, law in laws().items()}
    print(pd.DataFrame(table).T.round(1).to_string(na_rep=""))


if __name__ == "__main__":
    main()
