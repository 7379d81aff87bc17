"""Whether a fit has room in memory."""

from solver.fit.problem import Problem
from solver.fit.stretches import is_long
from solver.survey.memory import available, require_memory

#: Bytes that a fit takes: whatever it is of, by each number of the model's map (a vehicle's sample on a channel), and
#: by each of them and each pass. Measured on 8 to 40 passes over 51 to 98 channels (0.4 to 4.4 GB); right within 25 %.
ALWAYS, BY_CELL, BY_CELL_AND_PASS = 9.4e7, 5.05e3, 376.0


def fit_memory(rows: int, channels: int, passes: int) -> float:
    """Bytes that a fit of `rows` samples of all its vehicles, on some channels, takes at its largest.

    >>> round(fit_memory(2205, 98, 40) / 1e9, 1)
    4.4
    """
    return ALWAYS + rows * channels * (BY_CELL + BY_CELL_AND_PASS * passes)


def require_room_to_fit(problem: Problem) -> None:
    """Refuse a survey whose fit does not fit into memory; a long fiber is fitted stretch by stretch and always does.

    Raises
    ------
    InputError
        Says how many channels, or how many passes, would.
    """
    if is_long(problem):
        return
    rows, channels, passes = len(problem.traffic.pass_index), len(problem.channel), len(problem.passes)
    room = available()
    fewer_channels = max((n for n in range(channels) if fit_memory(rows, n, passes) <= room), default=0)
    fewer_passes = max((n for n in range(passes) if fit_memory(rows * n // passes, channels, n) <= room), default=0)
    require_memory(
        fit_memory(rows, channels, passes),
        f"fitting {channels} channels and {passes} passes",
        f"name {fewer_channels} channels at most, channels = [first, last], in [das] of site.toml, or give the tracks "
        f"of {fewer_passes} passes",
    )
