"""Physical limits: a number beyond one of them is in the wrong unit, or a mistake."""

#: m; a vehicle farther than this from a channel is ignored: it causes under 1 % of its largest response.
VEHICLE_REACH = 25.0
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
