"""Effects that the base model lacks: the catalogue, and users' own.

A user's own effect is a function of one stage, in a file of theirs (`roadfiber diagnose RUN --plugin mine.py`):

>>> from solver.effects import Parameter, effect
>>> @effect("tire_pressure", "load", [Parameter("share", "1", 0.1)], physics="Soft tires.", source="Mine.")
... def tire_pressure(load, p, survey):
...     return load.modulated(1 + p["share"] * load.trajectory.speed / 20, 0 * load.trajectory.speed)
"""

from solver.effects.effect import Effect, Parameter, effect

__all__ = ["Effect", "Parameter", "effect"]
