"""Limits of nature: a number beyond one of them is in the wrong unit, or a mistake."""

#: A vehicle farther than this from a channel is not felt, m: under 1 % of its response when nearest.
FELT = 25.0
#: m/s; no vehicle on a road is faster (324 km/h).
FASTEST = 90.0
#: Strain at which silica breaks at once (5 %: proof tests stop at 1 to 2 %): no fiber is stretched so between samples.
BREAKING = 0.05
#: 1/s; the best interrogators resolve strains of 1e-12 in a second, and the lightest car makes a thousand times that.
FAINTEST = 1e-13
#: m; from the pulses of frequency-domain interrogators to those of 10 us.
GAUGE_LENGTHS = (0.01, 1000.0)
#: m; from scatter resolved by frequency-domain interrogators to so far apart that vehicles pass between channels.
CHANNEL_SPACINGS = (0.001, 2 * FELT)
