"""Work that the workbench does in the background."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Job:
    """Work under way in the background, or done.

    Parameters
    ----------
    title : what is done
    named : gives the title of an effect by its name
    begun : when, s of a clock that only runs forward
    words : what it said last
    fits : of each fit so far: in words, and chi2 per sample by step
    done, of : how far it is, where that is known
    ended : whether it has ended
    came : how, in a word
    """

    title: str
    named: Callable[[str], str] = str
    begun: float = field(default_factory=time.monotonic)
    words: str = ""
    fits: list[tuple[str, list[tuple[int, float]]]] = field(default_factory=list)
    done: int = 0
    of: int = 0
    ended: bool = False
    came: str = "Done"

    def take(self, step: tuple[Any, ...]) -> None:
        """Take in what the worker told.

        >>> job = Job("adding", {"gauge_length": "Gauge length"}.__getitem__)
        >>> for step in (1, 2, 1):
        ...     job.take(("step", ("gauge_length", 8, step, 1.2)))
        >>> job.fits
        [('Gauge length, 8 passes', [(1, 1.2), (2, 1.2)]), ('Gauge length, 8 passes', [(1, 1.2)])]
        """
        if step[0] == "step":
            effects, passes, number, misfit = step[1]
            titles = ", ".join(map(self.named, filter(None, effects.split(", "))))
            name = f"{titles or 'the base model'}, {passes} passes"
            if not self.fits or self.fits[-1][0] != name or self.fits[-1][1][-1][0] >= number:
                self.fits.append((name, []))
            self.fits[-1][1].append((number, misfit))
        elif step[0] == "done":
            self.done, self.of = step[1:]
        else:
            self.words = str(step[1])
