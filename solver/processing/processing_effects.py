"""Processing stage: what was done to the data and not to the model."""

from collections.abc import Mapping

import numpy as np
from torch import Tensor
from torch.nn.functional import pad

from solver.effect import Parameter, Plain, Recorded, Surroundings, effect, percent
from solver.processing import fk_filter
from solver.processing.processing import Processing
from solver.processing.spectrum import fan_contrast, repeated_share

Values = Mapping[str, Tensor]

#: Contrast of the noise's spectrum that an FK filter leaves, and share of repeated samples that a median filter does.
FILTERED, REPEATED = 5.0, 0.05


@effect(
    "common_mode",
    "processing",
    [Parameter("share", "1", 0.5, lower=-0.5, upper=1.5)],
    physics="The mean over all channels was subtracted, and part of the signal with it.",
    plain=Plain(
        "Removed mean", "{size} of the mean over all channels was subtracted from the record.", size=percent, unit="%"
    ),
    source="Lindsey et al. 2020, JGR Solid Earth 125: removal of laser phase noise.",
)
def common_mode(processing: Processing, p: Values, survey: Surroundings) -> Processing:
    """A share of the mean over the record's channels is removed; those not fitted are taken to sense nothing."""
    channels = max(survey.recorded, len(survey.distance))
    return processing.then(lambda rate: rate - p["share"] * rate.sum(-1, keepdim=True) / channels)


def repeats(record: Recorded) -> str | None:
    """What a median filter leaves: samples that are exactly their neighbors'."""
    repeated = repeated_share(np.where(record.still, record.values, np.nan))
    if repeated <= REPEATED:
        return None
    return f"{100 * repeated:.0f} % of the samples are exactly the same as their neighbors"


def fan(record: Recorded) -> str | None:
    """What an FK filter leaves: noise at the speeds that it kept. Medians smooth, and leave less beside these too."""
    if repeats(record) is not None:
        return None
    noise = np.where(record.still, record.values, np.nan)
    contrast = fan_contrast(noise, record.sampling_rate, record.channel_spacing)
    # Where the sampling cannot tell there is no contrast.
    if not contrast > FILTERED:
        return None
    return f"noise at speeds and frequencies of vehicles is {contrast:.0f} times that beside them"


@effect(
    "fk_filter",
    "processing",
    [Parameter("share", "1", 1.0, lower=0, upper=1.2)],
    physics="The data were filtered to the speeds of vehicles, the model was not.",
    plain=Plain("Speed filter", "The record was filtered to the speeds of vehicles.", size=percent, unit="%"),
    source="Yilmaz 2001, Seismic Data Analysis, section 6.",
    trace=fan,
)
def filtered_by_speed(processing: Processing, p: Values, survey: Surroundings) -> Processing:
    """FK filter, 9 to 90 km/h and below 1 Hz; share 1 is the whole of it."""
    dt, dx = 1 / survey.sampling_rate, survey.channel_spacing
    return processing.then(lambda rate: rate + p["share"] * (fk_filter(rate, dt, dx) - rate))


@effect(
    "median_filter",
    "processing",
    [Parameter("share", "1", 1.0, lower=0, upper=1.2)],
    physics="The data went through a running median, the model did not.",
    plain=Plain("Running median", "The record went through a running median.", size=percent, unit="%"),
    source="Tukey 1977, Exploratory Data Analysis, section 7.",
    trace=repeats,
)
def median_filter(processing: Processing, p: Values, survey: Surroundings) -> Processing:
    """Median of 3 samples by 5 channels; share 1 is the whole of it."""

    def median(rate: Tensor) -> Tensor:
        flat = rate.reshape(-1, 1, *rate.shape[-2:])
        windows = pad(flat, (2, 2, 1, 1), mode="replicate")[:, 0].unfold(1, 3, 1).unfold(2, 5, 1)
        return windows.flatten(-2).median(-1).values.reshape(rate.shape)

    return processing.then(lambda rate: rate + p["share"] * (median(rate) - rate))


EFFECTS = (common_mode, filtered_by_speed, median_filter)
