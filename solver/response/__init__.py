"""What a passing vehicle leaves in a straight fiber: its shape, width and sensitivity by offset and depth."""

from solver.response.coupling import CouplingCurve, coupling_curve
from solver.response.maps import ResponseMaps, response_maps
from solver.response.straight import straight_strain_rate

__all__ = ["CouplingCurve", "ResponseMaps", "coupling_curve", "response_maps", "straight_strain_rate"]
