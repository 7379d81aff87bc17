"""Ground responses beyond the vertical point load on a homogeneous half-space.

Each is a function of the same shape as `solver.ground.displacement_rate`, in the same unit per F / (4 pi G), and equal
to it at its null parameter.
"""
