"""An independent generator of surveys in numpy and scipy; it shares no code with the signal path that it checks.

`simulate(Scenario(seed=3))` returns a `Survey`; `write_survey(survey, folder)` writes it as a user would
bring it. `Scenario(effects={"shear_lag": 2.0})` hides an effect; `EFFECTS` lists all effects, the meaning of their
amounts, and their further settings.
"""

from solver.simulator.check import RouteError, route_error
from solver.simulator.effects import EFFECTS
from solver.simulator.scenario import BUILT_IN, Scenario, amounts, read_scenario
from solver.simulator.simulated_survey import Survey, simulate
from solver.simulator.survey_files import write_survey
from solver.simulator.vehicle import Vehicle

__all__ = [
    "BUILT_IN",
    "EFFECTS",
    "RouteError",
    "Scenario",
    "Survey",
    "Vehicle",
    "amounts",
    "read_scenario",
    "route_error",
    "simulate",
    "write_survey",
]
