"""Processing stage: what is done to the map of strain rate afterwards."""

from dataclasses import dataclass, replace

from solver.effect.transfers import MapFunction


@dataclass(frozen=True)
class Processing:
    """What is done to the map afterwards: functions of a gapless stretch of it, [..., sample, channel]."""

    steps: tuple[MapFunction, ...] = ()

    def then(self, step: MapFunction) -> "Processing":
        """With one more step."""
        return replace(self, steps=(*self.steps, step))
