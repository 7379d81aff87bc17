"""Physical limits: a number beyond one of them is in the wrong unit, or a mistake."""

#: m; a vehicle farther than this from a channel with a usual gauge is ignored: it causes under 4 % of its largest
#: response in a fiber 3 to 5 m beside its lane, and that at the outermost channels only.
VEHICLE_REACH = 25.0
#: m; and how much farther longer gauges sense as much, per meter of gauge: what their two ends sense cancels less.
USUAL_GAUGE, PER_METER = 10.0, 0.75
#: m/s; no vehicle on a road is faster (324 km/h).
FASTEST = 90.0
#: 1/s; strain rate in an earthquake that shakes soft ground (waves of 100 m/s) at the acceleration of gravity.
LOUDEST = 0.1
#: 1/s; the best interrogators resolve strains of 1e-12 in a second; the lightest car causes a thousand times that.
FAINTEST = 1e-13
#: m^2; a vehicle's weight over 4 pi times the shear modulus of its ground: from a motorcycle (1e3 N) on granite (3e10
#: Pa), coupled to a tenth, to a road train (1e6 N) on peat (1e6 Pa).
PUSHES = (1e-10, 0.1)
#: m; from the pulses of frequency-domain interrogators to those of 10 us.
GAUGE_LENGTHS = (0.01, 1000.0)
#: m; from scatter resolved by frequency-domain interrogators to thinned exports of long fibers.
CHANNEL_SPACINGS = (0.001, 200.0)


def farther(gauge_length: float) -> float:
    """How much farther from its middle a gauge senses vehicles than a usual one, m.

    >>> farther(8.0), farther(50.0)
    (0.0, 30.0)
    """
    return PER_METER * max(0.0, gauge_length - USUAL_GAUGE)


def vehicle_reach(gauge_length: float) -> float:
    """How far from the middle of a gauge a vehicle may be before it is ignored, m."""
    return VEHICLE_REACH + farther(gauge_length)
