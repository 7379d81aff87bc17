"""Ground responses beyond the vertical point load on a homogeneous half-space.

Each is a function of the same shape as `solver.ground.displacement_rate`, in the same unit per F / (4 pi G), and equal
to it at its null parameter.
"""

from solver.half_space.gibson import gibson_displacement, gibson_displacement_rate, gibson_response
from solver.half_space.layered import (
    layered_displacement,
    layered_displacement_rate,
    layered_response,
    pavement_displacement_rate,
    pavement_response,
)
from solver.half_space.moving import moving_displacement_rate
from solver.half_space.tangential import tangential_displacement, tangential_displacement_rate

__all__ = [
    "gibson_displacement",
    "gibson_displacement_rate",
    "gibson_response",
    "layered_displacement",
    "layered_displacement_rate",
    "layered_response",
    "moving_displacement_rate",
    "pavement_displacement_rate",
    "pavement_response",
    "tangential_displacement",
    "tangential_displacement_rate",
]
