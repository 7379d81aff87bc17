"""Trajectory stage: where the vehicles are."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor


@dataclass(frozen=True)
class Trajectory:
    """Where the vehicles are; a row is one vehicle at one sample.

    Parameters
    ----------
    time : [row, 1], s since the record's start
    since : [row, 1], s since the vehicle's first row
    position, velocity : [row, 1 or channel, 2], m and m/s
    heading : [row, 1 or channel, 2], unit vector along travel
    pass_index : [row], which pass
    """

    time: Tensor
    since: Tensor
    position: Tensor
    velocity: Tensor
    heading: Tensor
    pass_index: Tensor

    @property
    def speed(self) -> Tensor:
        """[row, 1], m/s."""
        return self.velocity.norm(dim=-1)

    @property
    def right(self) -> Tensor:
        """[row, 1 or channel, 2], unit vector to the driver's right."""
        return torch.stack([-self.heading[..., 1], self.heading[..., 0]], -1)

    def since_passing(self, beyond: Tensor) -> Tensor:
        """Time [row, 1 or channel], s, since each vehicle was where `beyond` [row, 1 or channel], m on its way, is 0.

        By its sample nearest to there and the speed that it had, so that it may slow down before and after.
        """
        with torch.no_grad():
            away = beyond[:, :1].abs()
            least = away.new_full((int(self.pass_index.max()) + 1,), torch.inf)
            least = least.scatter_reduce(0, self.pass_index, away[:, 0], "amin")[self.pass_index]
            nearest = (away[:, 0] == least).nonzero()[:, 0]
            row = torch.zeros(int(self.pass_index.max()) + 1, dtype=torch.long)
            row = row.index_copy(0, self.pass_index[nearest], nearest)[self.pass_index]
            speed = self.speed.clamp_min(0.5)[row]
            passed = self.time - self.time[row] + beyond[row] / speed
        # Each sample's own place alone is differentiated: a place, or a shift of the vehicle, moves all of them alike.
        return passed + (beyond - beyond.detach()) / speed

    def shifted(self, along: Tensor | float = 0.0, across: Tensor | float = 0.0) -> "Trajectory":
        """Moved along travel and to the right, each [row, 1 or channel], m."""
        forward, sideways = torch.as_tensor(along)[..., None], torch.as_tensor(across)[..., None]
        return replace(self, position=self.position + forward * self.heading + sideways * self.right)
