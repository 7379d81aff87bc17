"""The code box: what it begins with."""

#: File name that the box begins with.
NAME = "my_effect.py"
#: Ten lines that define an effect.
TEMPLATE = """\
from roadfiber import Parameter, effect


@effect(
    "downforce", "load", [Parameter("share", "1", 0.05, lower=-0.5, upper=0.5)],
    physics="Air presses on a vehicle, by the square of its speed.", source="Hucho 1998, section 2.",
)
def downforce(load, p, survey):
    factor = 1 + p["share"] * (load.trajectory.speed / 30) ** 2
    return load.modulated(factor, 0 * factor)
"""
