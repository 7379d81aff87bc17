"""Effects of the catalogue: stage, meaning of the amount, plausible amounts, secondary settings."""

from solver.simulator.hidden import Hidden, Setting

KNOWN: dict[str, Hidden] = {
    # --- load
    "wheel_layout": Hidden("load", "1: the trajectories call every class `vehicle`", (1, 1)),
    "point_load": Hidden("load", "1: every vehicle is one point load, as published, and its class `vehicle`", (1, 1)),
    "front_share": Hidden(
        "load", "more of every vehicle's load is on its front axle, by this share", (0.05, 0.12), signed=True
    ),
    "long_vehicle": Hidden(
        "load",
        "m from first to last axle of every third vehicle, called a truck",
        (8, 18),
        {"axles": Setting(5, 5, "number of axles, evenly apart and evenly laden")},
    ),
    "dynamic_load": Hidden(
        "load",
        "A of F (1 + A sin(2 pi f t + p)), p by chance for each vehicle",
        (0.05, 0.3),
        {"frequency": Setting(1.3, 2.3, "Hz, f")},
    ),
    "road_bump": Hidden(
        "load",
        "first swing of the load's damped oscillation after a bump, relative to the load",
        (0.1, 0.5),
        {
            "at": Setting(0.35, 0.65, "share of the view from its low end, where the bump is"),
            "frequency": Setting(1.3, 2.0, "Hz, undamped"),
            "damping": Setting(0.15, 0.3, "share of critical"),
        },
    ),
    "braking": Hidden(
        "load",
        "g; largest deceleration of some vehicles, which push the ground ahead and dip",
        (0.05, 0.4),
        {
            "at": Setting(0.3, 0.55, "share of the view, as driven, where braking begins"),
            "time": Setting(1.5, 2.5, "s that it lasts"),
            "length": Setting(0, 0, "m of road over which brakes are held instead; 0: they come and go"),
            "share": Setting(0.4, 0.4, "of the vehicles that brake"),
            "height": Setting(0.6, 0.6, "m; of the center of mass"),
        },
    ),
    "grade_drag": Hidden("load", "share of the load by which driven wheels push the ground back", (0.02, 0.08)),
    "camber": Hidden("load", "share of the load that pushes the ground to the right of the vehicle", (0.015, 0.03)),
    "unseen_vehicle": Hidden("load", "load, relative to a car's, of a vehicle that the trajectories lack", (0.1, 2)),
    # --- ground
    "poisson_ratio": Hidden("ground", "added to the scenario's Poisson ratio", (0.05, 0.2), signed=True),
    "poisson_gradient": Hidden(
        "ground",
        "Poisson ratio falls by this before, rises by this beyond a place: tanh",
        (0.05, 0.15),
        {
            "at": Setting(0.4, 0.6, "share of the view from its low end, where it is the scenario's"),
            "width": Setting(5, 15, "m; of the tanh"),
        },
        signed=True,
    ),
    "stiffness_contrast": Hidden(
        "ground",
        "ln of the ratio of shear moduli beyond and before a place",
        (0.2, 1.4),
        {
            "at": Setting(0.5, 0.5, "share of the view from its low end"),
            "width": Setting(2, 2, "m; of the tanh"),
        },
        signed=True,
    ),
    "layered_ground": Hidden(
        "ground",
        "ln of the ratio of shear moduli below and above a depth",
        (0.7, 2.3),
        {"depth": Setting(1.5, 5.0, "m")},
    ),
    "pavement": Hidden(
        "ground",
        "m; thickness of a stiff plate on the ground",
        (0.15, 0.3),
        {"ratio": Setting(10, 40, "its stiffness")},
    ),
    "gibson_soil": Hidden("ground", "1/m; the shear modulus is G (1 + value * depth)", (0.3, 3)),
    "moving_load": Hidden(
        "ground", "speed of 15 m/s relative to that of shear waves; the ground's inertia counts", (0.1, 0.3)
    ),
    "viscoelastic_lag": Hidden(
        "ground",
        "delayed strain relative to the immediate one (standard linear solid); other models: see model",
        (0.1, 0.5),
        {
            "tau": Setting(0.3, 0.6, "s, in which the delayed strain comes"),
            "model": Setting(
                0, 0, "0 standard linear solid; 1 Kelvin-Voigt, amount s of lag; 2 Maxwell, amount 1/s of flow"
            ),
        },
    ),
    "rayleigh_wave": Hidden(
        "ground",
        "largest rate of a surface wave at 10 m, relative to the vehicle's largest",
        (0.002, 0.03),
        {
            "frequency": Setting(2.6, 12, "Hz"),
            "speed": Setting(120, 220, "m/s"),
        },
    ),
    # --- cable
    "channel_coupling": Hidden("cable", "sd of the smooth log gain along the fiber", (0.1, 0.5)),
    "shear_lag": Hidden("cable", "m; L of the strain transfer 1 / (1 + k^2 L^2)", (1.2, 3)),
    "conduit_slip": Hidden(
        "cable",
        "m of fiber that slips in its conduit and senses its mean strain only",
        (8, 50),
        {"at": Setting(0.4, 0.6, "middle, as share of the active channels")},
    ),
    "slack_spool": Hidden(
        "cable",
        "m of fiber that lie coiled in a manhole and sense nothing",
        (1, 30),
        {"at": Setting(0.4, 0.6, "place, as share of the channels")},
    ),
    "sloping_fiber": Hidden(
        "cable",
        "steepest slope of the fiber, up and down",
        (0.03, 0.06),
        {"wavelength": Setting(25, 40, "m of its undulation in depth")},
    ),
    "curved_gauge": Hidden(
        "cable",
        "1/m; largest curvature of the fiber on the map, left and right",
        (0.01, 0.03),
        {"wavelength": Setting(25, 40, "m of its undulation")},
    ),
    "channel_stretch": Hidden(
        "cable",
        "relative: channels lie this much farther apart than the file says",
        (0.002, 0.02),
        signed=True,
    ),
    "channel_wander": Hidden("cable", "m; sd of the channels' smooth departure along the fiber", (0.1, 1)),
    # --- interrogator
    "gauge_length": Hidden(
        "interrogator", "relative error: the true gauge is (1 + value) the one told", (0.05, 0.2), signed=True
    ),
    "pulse_width": Hidden(
        "interrogator",
        "m of an additional average along the fiber (a Gaussian's equivalent width: sqrt(12) sd)",
        (4, 10),
        {"gaussian": Setting(0, 0, "1: Gaussian; 0: box")},
    ),
    "time_averaging": Hidden("interrogator", "s of strain rate averaged, up to the stamp", (0.1, 0.4)),
    "highpass": Hidden(
        "interrogator",
        "Hz; corner of the AC coupling",
        (0.01, 0.2),
        {"order": Setting(1, 1, "of the Butterworth filter")},
    ),
    "lowpass": Hidden(
        "interrogator",
        "Hz; corner of the anti-alias filter",
        (0.8, 2.2),
        {
            "order": Setting(4, 4, "of the Butterworth filter"),
            "zero_phase": Setting(0, 0, "1: run both ways, without delay; 0: causal"),
        },
    ),
    "saturation": Hidden("interrogator", "strain rates are clipped at this share of the largest", (0.3, 0.8)),
    "cycle_skips": Hidden(
        "interrogator",
        "share of samples with a phase-unwrapping jump where the rate is above a tenth of the largest",
        (0.001, 0.02),
        {"size": Setting(0.8, 1.4, "of a jump, relative to the largest rate")},
    ),
    # --- processing
    "common_mode": Hidden("processing", "this share of the mean over all channels was removed", (0.5, 1)),
    "laser_noise": Hidden("processing", "sd of noise common to all channels, relative to the noise", (0.5, 2)),
    "fk_filter": Hidden(
        "processing",
        "1: only what moves along the fiber at a vehicle's speed was kept",
        (1, 1),
        {
            "slowest": Setting(3, 3, "m/s"),
            "fastest": Setting(60, 60, "m/s"),
            "frequency": Setting(1.0, 1.0, "Hz; highest kept"),
        },
    ),
    "median_filter": Hidden(
        "processing",
        "1: a running median was taken",
        (1, 1),
        {
            "samples": Setting(3, 3, "window in time"),
            "channels": Setting(5, 5, "window along the fiber"),
        },
    ),
    # --- trajectory: the amount is what must be added to the table's values to correct them
    "clock_offset": Hidden(
        "trajectory",
        "s; the interrogator's clock is ahead of the trajectories' by this much",
        (0.05, 0.5),
        signed=True,
    ),
    "clock_drift": Hidden(
        "trajectory", "the trajectories' clock loses this share of the time", (5e-4, 5e-3), signed=True
    ),
    "track_bias": Hidden(
        "trajectory", "m; vehicles are this much farther ahead, as they drive, than told", (0.2, 2), signed=True
    ),
    "track_offset": Hidden(
        "trajectory",
        "m; everything is this much farther to the right of +x than told",
        (0.1, 1),
        {"along": Setting(0, 0, "m; and this much farther along x")},
        signed=True,
    ),
    "track_rotation": Hidden(
        "trajectory", "degrees clockwise from above, about the view's middle", (0.3, 2), signed=True
    ),
    "track_scale": Hidden(
        "trajectory",
        "relative; distances from the view's middle are this much longer",
        (0.005, 0.03),
        signed=True,
    ),
    "track_bend": Hidden(
        "trajectory",
        "m; y is farther right by this at the view's ends, by none in its middle",
        (0.2, 1),
        signed=True,
    ),
    "track_jitter": Hidden(
        "trajectory",
        "m; sd of a slow error of each track, in x and in y",
        (0.1, 0.6),
        {"time": Setting(1.5, 4, "s; correlation time")},
    ),
}
