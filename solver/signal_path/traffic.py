"""The vehicles of a survey as tensors: their positions at every relevant sample, and what a fit may change.

Rows are (pass, sample) pairs of all passes, one after the other, so that any number of vehicles, meeting or apart, is
one tensor operation; rows of the same sample superpose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from scipy.interpolate import make_interp_spline
from torch import Tensor

from solver.load.wheel_layout import class_number, layout_of
from solver.noise.sample_runs import blocks_of
from solver.trajectory.vehicle_pass import Pass

#: Quantities that change along a vehicle's path, and the polynomial degree by which each is interpolated.
MOVING = {"position": 3, "velocity": 1, "heading": 1, "sigma": 1}


@dataclass(frozen=True)
class Traffic:
    """Position of every vehicle at every sample that it affects.

    Parameters
    ----------
    passes : number of passes
    pass_index : [row], which pass
    sample_index : [row], which of `samples`
    samples : [sample], rows of the record, ascending; in units of a row over `over`
    position, velocity : [row, 2], m and m/s
    heading : [row, 2], unit vector along travel
    sigma : [row, 2], standard deviation of the position, m
    class_index : [pass], see `solver.load.wheel_layout.class_number`
    over : moments per sample of the record
    """

    passes: int
    pass_index: Tensor
    sample_index: Tensor
    samples: np.ndarray
    position: Tensor
    velocity: Tensor
    heading: Tensor
    sigma: Tensor
    class_index: Tensor
    over: int = 1

    @classmethod
    def of(cls, passes: Sequence[Pass], more: np.ndarray | None = None) -> "Traffic":
        """Stack passes; `more` are rows of the record to include beside those with a vehicle."""
        record_rows = np.concatenate([p.rows for p in passes])
        samples = np.unique(record_rows if more is None else np.concatenate([record_rows, more]))
        sample_index = np.searchsorted(samples, record_rows)
        stack = {
            name: torch.from_numpy(np.concatenate([getattr(p, name) for p in passes]))
            for name in ("position", "velocity", "sigma")
        }
        heading = torch.from_numpy(np.concatenate([_heading(p) for p in passes]))
        index = np.repeat(np.arange(len(passes)), [len(p.rows) for p in passes])
        return cls(
            len(passes),
            torch.from_numpy(index),
            torch.from_numpy(sample_index),
            samples,
            heading=heading,
            class_index=torch.tensor([class_number(p.vehicle_class) for p in passes]),
            position=stack["position"],
            velocity=stack["velocity"],
            sigma=stack["sigma"],
        )

    def take(self, chosen: np.ndarray) -> "Traffic":
        """Keep only `chosen` (ascending indices into `samples`)."""
        place = torch.full((len(self.samples),), -1)
        place[torch.from_numpy(chosen)] = torch.arange(len(chosen))
        keep = place[self.sample_index] >= 0
        rows = {name: getattr(self, name)[keep] for name in ("pass_index", "position", "velocity", "heading", "sigma")}
        return Traffic(
            self.passes,
            sample_index=place[self.sample_index][keep],
            samples=self.samples[chosen],
            class_index=self.class_index,
            **rows,
        )

    def finer(self, over: int) -> "Traffic":
        """The same with `over` moments per sample, where samples are consecutive."""
        samples = np.concatenate([np.arange(b.start, b.stop) for b in stretched(self.samples, over)])
        parts: dict[str, list[np.ndarray]] = {name: [] for name in ("pass", "at", *MOVING)}
        record_row = self.samples[self.sample_index.numpy()]
        for number in range(self.passes):
            mine = np.flatnonzero(self.pass_index.numpy() == number)
            for run in blocks_of(record_row[mine]):
                rows = mine[run]
                known = record_row[rows]
                moment = np.arange(known[0] * over, known[-1] * over + 1)
                parts["pass"].append(np.full(len(moment), number))
                parts["at"].append(np.searchsorted(samples, moment))
                for name, degree in MOVING.items():
                    spline = make_interp_spline(known, getattr(self, name)[rows].numpy(), min(degree, len(known) - 1))
                    parts[name].append(spline(moment / over))
        stack = {name: torch.from_numpy(np.concatenate(part)) for name, part in parts.items()}
        heading = stack["heading"] / stack["heading"].norm(dim=1, keepdim=True)
        rows_of = {"pass_index": stack["pass"], "sample_index": stack["at"], "heading": heading}
        rows_of |= {name: stack[name] for name in MOVING if name != "heading"}
        return replace(self, samples=samples, over=over * self.over, **rows_of)

    @property
    def sampled(self) -> np.ndarray:
        """Which of `samples` are samples of the record, [sample] bool."""
        return np.asarray(self.samples % self.over == 0)

    @property
    def record_sample(self) -> Tensor:
        """The sample of the record at, or last before, each row, [row]."""
        return torch.from_numpy(np.cumsum(self.sampled) - 1)[self.sample_index]

    def superpose(self, rows: Tensor) -> Tensor:
        """Sum responses [row, ...] of the same sample -> [sample, ...]."""
        total = rows.new_zeros((len(self.samples), *rows.shape[1:]))
        return total.index_add(0, self.sample_index, rows)


def stretched(samples: np.ndarray, over: int) -> list[slice]:
    """Moments of each gapless stretch of samples, `over` of them per sample.

    >>> stretched(np.array([4, 5, 9]), 3)
    [slice(12, 16, None), slice(27, 28, None)]
    """
    ends = ((int(samples[b.start]), int(samples[b.stop - 1])) for b in blocks_of(samples))
    return [slice(first * over, last * over + 1) for first, last in ends]


def _heading(one: Pass) -> np.ndarray:
    # A stationary vehicle keeps the direction of its whole pass.
    chord = one.position[-1] - one.position[0]
    speed = np.linalg.norm(one.velocity, axis=1, keepdims=True)
    moving = np.where(speed > 0.5, one.velocity, chord)
    return moving / np.maximum(np.linalg.norm(moving, axis=1, keepdims=True), 1e-9)


@dataclass
class Vehicles:
    """What the fit may change about each vehicle.

    Parameters
    ----------
    amplitude : [pass], F / (4 pi G) times coupling, m^2
    along, across : [pass], shift of the load along travel and to its right, m
    wheelbase, track : [pass], m
    front_share : [pass], share of the load on the front axle
    """

    amplitude: Tensor
    along: Tensor
    across: Tensor
    wheelbase: Tensor
    track: Tensor
    front_share: Tensor

    @classmethod
    def of(cls, passes: Sequence[Pass]) -> "Vehicles":
        """Layouts of their class or their own wheelbase, unit amplitude, no shift."""
        layouts = [layout_of(p.vehicle_class, p.wheelbase) for p in passes]
        zeros = torch.zeros(len(passes), dtype=torch.float64)
        columns = {
            name: torch.tensor([getattr(layout, name) for layout in layouts], dtype=torch.float64)
            for name in ("wheelbase", "track", "front_share")
        }
        return cls(amplitude=torch.ones_like(zeros), along=zeros.clone(), across=zeros.clone(), **columns)

    def rows(self, traffic: Traffic) -> "Vehicles":
        """Per row instead of per pass."""
        return Vehicles(*(getattr(self, f.name)[traffic.pass_index] for f in fields(self)))


def columns(vehicles: Vehicles) -> Vehicles:
    """Vehicles per row [row] with a channel axis, [row, 1]."""
    return Vehicles(*(getattr(vehicles, f.name)[:, None] for f in fields(vehicles)))
