"""How an effect and its size are told to people who do not know the field's terms."""

from collections.abc import Callable
from dataclasses import dataclass
from math import expm1, inf, log
from sys import float_info

#: Logarithm of the largest ratio that percent can tell.
LARGEST = log(float_info.max) - log(100.0)


@dataclass(frozen=True)
class Setting:
    """What the size of an effect may depend on in a survey, where it is told in words.

    Parameters
    ----------
    gauge_length, channel_spacing : m, as told
    x : middle of the stretch of road that was observed, m
    along : middle of the fitted channels, m along the fiber
    """

    gauge_length: float
    channel_spacing: float
    x: float
    along: float


def as_it_is(value: float, setting: Setting) -> float:
    """The number itself."""
    return value


def absolute(value: float, setting: Setting) -> float:
    """The number without its sign."""
    return abs(value)


def percent(value: float, setting: Setting) -> float:
    """A share in percent."""
    return 100 * value


def percents(value: float, setting: Setting) -> float:
    """A share in percent, without its sign."""
    return 100 * abs(value)


def grown(value: float, setting: Setting) -> float:
    """The logarithm of a ratio as percent more or less; infinity beyond any number, as of what no record could show.

    >>> here = Setting(gauge_length=10.0, channel_spacing=1.0, x=50.0, along=120.0)
    >>> grown(0.0, here), grown(1e4, here)
    (0.0, inf)
    """
    return 100 * expm1(value) if value < LARGEST else inf


def root(value: float, setting: Setting) -> float:
    """The root of what enters by its square."""
    return float(max(value, 0.0) ** 0.5)


@dataclass(frozen=True)
class Plain:
    """An effect as a city engineer reads it.

    Parameters
    ----------
    title : two or three words
    sentence : what is the case, in plain words, where "{size}" stands for the size with its unit, "{told}" for the size
        that the survey was told, "{x}" and "{along}" for its place along the road and along the fiber, and the names of
        shape parameters for their values; "" where the physics say it
    opposite : the same for a negative size, which is told without its sign; "" where the sentence holds for both
    size : (value of its first number, setting) -> its size in the unit below
    unit : that people know; "" for that of its first number
    """

    title: str
    sentence: str = ""
    opposite: str = ""
    size: Callable[[float, Setting], float] = as_it_is
    unit: str = ""
