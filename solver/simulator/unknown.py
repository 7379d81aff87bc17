"""Effects outside the catalogue, to test what a diagnosis says about effects that it does not know."""

from solver.simulator.hidden import Hidden, Setting

UNKNOWN: dict[str, Hidden] = {
    # --- load
    "unknown_road_profile": Hidden(
        "load",
        "sd of the load's smooth change along the road, the same for all vehicles",
        (0.1, 0.3),
        {"shortest": Setting(8, 12, "m; wavelength"), "longest": Setting(30, 50, "m; wavelength")},
    ),
    "unknown_speed_load": Hidden("load", "load grows by this when the speed doubles", (0.2, 0.6), signed=True),
    "unknown_wake": Hidden(
        "load",
        "share of a large vehicle's load by which the air behind it sucks, over a stretch of road",
        (0.15, 0.4),
        {"length": Setting(10, 20, "m")},
    ),
    # --- ground
    "unknown_wave_packet": Hidden(
        "ground",
        "largest rate of a wave packet that trails the vehicle, relative to the vehicle's largest",
        (0.05, 0.2),
        {"behind": Setting(12, 25, "m"), "wavelength": Setting(10, 18, "m"), "width": Setting(5, 8, "m; sd")},
    ),
    "unknown_anisotropy": Hidden("ground", "distances across the road count this much more", (0.05, 0.2), signed=True),
    "unknown_softening": Hidden("ground", "more strain by this share where it is largest, in proportion", (0.2, 0.6)),
    "unknown_hysteresis": Hidden(
        "ground",
        "strain that stays behind by friction, relative to the elastic one",
        (0.2, 0.5),
        {"play": Setting(0.1, 0.25, "of the largest strain, before friction gives way")},
    ),
    # --- cable
    "unknown_twin_path": Hidden(
        "cable",
        "share of the light that runs in a second duct",
        (0.2, 0.5),
        {"aside": Setting(5.0, 9.0, "m farther from the road than the first")},
    ),
    # --- interrogator
    "unknown_skewed_kernel": Hidden(
        "interrogator",
        "share of the reading that comes from farther along the fiber only",
        (0.2, 0.5),
        {"tail": Setting(4, 10, "m; an exponential's")},
    ),
    "unknown_echo": Hidden(
        "interrogator",
        "share of a reading that is that of a channel farther on",
        (0.05, 0.3),
        {"channels": Setting(20, 20, "how many farther on")},
    ),
    "unknown_quadratic": Hidden("interrogator", "rate + b rate^2 / largest", (0.15, 0.5), signed=True),
    "unknown_channel_delay": Hidden(
        "interrogator",
        "s that a channel is read later than one 100 before it",
        (0.1, 0.4),
        signed=True,
    ),
    "unknown_gain_drift": Hidden(
        "interrogator",
        "amplitude of a slow swing of the gain",
        (0.1, 0.4),
        {"period": Setting(3, 8, "s")},
    ),
    "unknown_exhaustion": Hidden(
        "interrogator",
        "gain lost for a while after the channel's largest rate",
        (0.3, 0.7),
        {"time": Setting(1, 3, "s in which it comes back")},
    ),
    # --- processing
    "unknown_difference": Hidden("processing", "share of the channel before that was subtracted", (0.3, 0.9)),
    "unknown_equalized": Hidden(
        "processing", "0 to 1; every sample was divided by this power of its rms over channels", (0.3, 0.8)
    ),
    # --- trajectory
    "unknown_tall_vehicles": Hidden(
        "trajectory",
        "m; trucks and buses, and half as much vans, are farther to the right than told",
        (0.6, 1.5),
        signed=True,
    ),
}
