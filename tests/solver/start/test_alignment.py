import numpy as np
import pytest

from solver.start.alignment import active_range, balanced
from solver.start.detections import Detections
from solver.start.fiber_line import FiberLine, ransac_line
from vision.contract import InputError


def scattered(slope: float, lag: float, outliers: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, speed, channel of 200 detections along x + speed lag = 50 + slope channel, a share of them anywhere."""
    rng = np.random.default_rng(seed)
    channel = rng.uniform(0, 100, 200)
    speed = rng.choice([-1, 1], 200) * rng.uniform(8, 20, 200)
    x = 50 + slope * channel - speed * lag + rng.normal(0, 0.5, 200)
    stray = rng.random(200) < outliers
    return x, speed, np.where(stray, rng.uniform(0, 240, 200), channel)


@pytest.mark.parametrize("slope", [1.02, -1.02])
@pytest.mark.parametrize("lag", [0.0, 0.4, -1.5])
def test_line_among_outliers(slope: float, lag: float):
    x, speed, channel = scattered(slope, lag, 0.5)
    line, inliers = ransac_line(x, speed, channel, 1.021)
    assert line is not None
    assert (line.x0, line.slope, line.lag) == pytest.approx((50.0, slope, lag), abs=0.5)
    assert abs(line.slope - slope) < 0.01
    assert 80 < inliers.sum() < 130


def test_one_way_traffic_says_nothing_about_the_clock():
    x, speed, channel = scattered(1.0, 0.0, 0.2)
    line, _ = ransac_line(x, np.abs(speed), channel, 1.0)
    assert line is not None
    assert line.lag == pytest.approx(0.0, abs=1e-9)


def test_no_line_with_a_possible_slope():
    x, speed, channel = scattered(0.2, 0.0, 0.0)
    line, inliers = ransac_line(x, speed, channel, 1.021)
    assert line is None or inliers.mean() < 0.3
    assert ransac_line(x[:2], speed[:2], channel[:2], 1.0)[0] is None


def test_channel_of_inverts_x_of():
    line = FiberLine(20.0, -1.02, 0.3)
    channel = np.array([3.0, 40.0])
    np.testing.assert_allclose(line.channel_of(line.x_of(channel) - 12.0 * 0.3, 12.0), channel)


def test_balanced_line_is_halfway_between_the_directions():
    def seen(speed: float, off: float, count: int) -> Detections:
        channel = np.linspace(0, 50, count)
        none = np.zeros(count)
        x = 10 + channel + off
        return Detections(none.astype(int), x, none, none + speed, channel, none, none, none[:, None])

    # Three passes one way and one the other: directions count alike, whatever the number of passes.
    line = balanced(
        FiberLine(10.0, 1.0, 0.0), [seen(10.0, 2.0, 9), seen(12.0, 2.0, 3), seen(9.0, 2.0, 5), seen(-9.0, 0.0, 4)]
    )
    assert line.x0 == pytest.approx(11.0)


def test_active_range_bridges_small_gaps_and_stays_in_view():
    share = np.ones(100)
    share[40:45] = 0.1
    share[70:] = np.nan
    assert active_range(share, (9.2, 200.0), 10) == (10, 69)
    assert active_range(share, (9.2, 200.0), 3) == (10, 69)
    share[48:70] = 0.1
    assert active_range(share, (9.2, 200.0), 4) == (10, 39)
    with pytest.raises(InputError, match="no channel sees"):
        active_range(np.zeros(100), (0.0, 99.0), 10)
