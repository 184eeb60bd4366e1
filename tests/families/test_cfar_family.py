"""Contract of noise estimators, checked for every member: thresholds, masks, training cells."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.cfar.base import MapNoise, NoiseEstimator, TrainingWindow
from dechirp.processing.spectrum import Transform
from nightly import nightly_except

# Training and guard cells (range, velocity), and shape of the map (velocity, range).
WINDOWS = {
    "default": ((10, 8), (4, 4), (26, 40)),
    "fills the map": ((3, 2), (1, 1), (7, 9)),
    "range alone": ((6, 0), (2, 0), (5, 30)),
    "range, one chirp": ((6, 0), (2, 0), (1, 30)),
    "velocity alone": ((0, 6), (0, 2), (40, 6)),
    "velocity, guard along range": ((0, 3), (2, 1), (12, 20)),
    "no guard": ((3, 2), (0, 0), (9, 40)),
    "thin": ((1, 1), (3, 3), (9, 70)),
}


def make_training_window(training, guard):
    cells = [dc.Cells(range=r, velocity=v) for r, v in (training, guard)]
    return TrainingWindow(n_training=cells[0], n_guard=cells[1])


def make_noise_map(shape, rng):
    """Make a map of noise with a clutter step, a ridge and a target."""
    power = rng.exponential(size=shape).astype(np.float32)
    power[:, shape[1] // 2 :] *= 30
    power[shape[0] // 3] *= 10
    power[shape[0] // 2, shape[1] // 4] = 1e6
    return power


def select_training_cells(power, v, j, window):
    """Return the powers and offsets of the training cells of one cell."""
    n_v, n_r = power.shape
    start = min(max(j - window.half_range, 0), n_r - 1 - 2 * window.half_range)
    cells, offsets = [], []
    for row in range(start, start + 2 * window.half_range + 1):
        for dv in range(-window.half_velocity, window.half_velocity + 1):
            if abs(row - j) > window.n_guard.range or abs(dv) > window.n_guard.velocity:
                cells.append(power[(v + dv) % n_v, row])
                offsets.append((dv, row - j))
    return np.array(cells), np.array(offsets)


def has_enough_training_cells(estimator, window):
    try:
        estimator.check_enough_training_cells(window)
    except dc.InvalidSetting:
        return False
    return True


CASES = [
    pytest.param(member(), *window, id=f"{kind}, {name}")
    for kind, member in NoiseEstimator.members().items()
    for name, window in WINDOWS.items()
    if has_enough_training_cells(member(), make_training_window(*window[:2]))
]


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), nightly_except(10, CASES))
def test_threshold_is_factor_times_statistic_of_training_cells(estimator, training, guard, shape):
    window, rng = make_training_window(training, guard), np.random.default_rng(301)
    power = make_noise_map(shape, rng)
    factors = rng.uniform(0.5, 3, shape[1]).astype(np.float32)
    threshold = estimator.threshold(power, window, factors)

    expected = np.empty(shape)
    for v, j in np.ndindex(shape):
        expected[v, j] = factors[j] * estimator.statistic(
            *select_training_cells(power, v, j, window)
        )
    assert threshold.dtype == np.float32
    # Sums of up to 700 single-precision cells.
    np.testing.assert_allclose(threshold, expected, rtol=5e-6)

    cells = np.argwhere(rng.uniform(size=shape) < 0.3)
    threshold_at_cells = estimator.threshold_at_cells(power, cells, window, factors)
    np.testing.assert_allclose(threshold_at_cells, threshold[cells[:, 0], cells[:, 1]], rtol=5e-6)


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), CASES)
def test_detection_mask_equals_power_above_threshold(estimator, training, guard, shape):
    window, rng = make_training_window(training, guard), np.random.default_rng(302)
    for factor in (0.7, 1.5, 6.0):
        power = make_noise_map(shape, rng)
        factors = (factor * rng.uniform(0.9, 1.1, shape[1])).astype(np.float32)
        mask = estimator.exceeds_threshold(power, window, factors)

        assert mask.dtype == bool and mask.any() and not mask.all()
        assert (mask == (power > estimator.threshold(power, window, factors))).all()
        # Scaling by 2^k is exact, so the mask does not change.
        assert (estimator.exceeds_threshold(power * 1024, window, factors) == mask).all()


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), CASES)
@pytest.mark.parametrize("level", [0.0, 3.7])
def test_threshold_of_constant_map_is_its_level(estimator, training, guard, shape, level):
    window = make_training_window(training, guard)
    power = np.full(shape, level, np.float32)
    ones = np.ones(shape[1], np.float32)
    np.testing.assert_allclose(estimator.threshold(power, window, ones), level, rtol=5e-6)
    assert not estimator.exceeds_threshold(power, window, 1.01 * ones).any()


@pytest.mark.parametrize("kind", NoiseEstimator.members())
def test_training_cells_agree_between_maps_and_theory(kind):
    estimator = NoiseEstimator.members()[kind]()
    white = Transform(window="rectangular", n_points=64, n_bins=64)
    noise = MapNoise(range_transform=white, doppler_transform=white)
    for training, guard, _ in WINDOWS.values():
        window = make_training_window(training, guard)
        if not has_enough_training_cells(estimator, window):
            continue
        for range_index in {0, window.half_range // 2, window.half_range}:
            covariance = window.noise_covariance_in_box(noise, range_index)
            assert (covariance.training_offsets == window.training_cell_offsets(range_index)).all()
            subsets = estimator.subsets_causing_false_alarms(covariance.training_offsets)
            assert subsets.shape[1] == covariance.n_training and subsets.any(axis=1).all()
            # In homogeneous noise, each false alarm probability has one factor.
            factor_at_1e_2, factor_at_1e_3 = (
                estimator.threshold_factor(pfa, covariance, n_channels=1).value
                for pfa in (1e-2, 1e-3)
            )
            assert 0 < factor_at_1e_2 < factor_at_1e_3
