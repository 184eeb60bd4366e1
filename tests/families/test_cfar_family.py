"""The contract of noise estimators, on every member there is: a map is as its definition says."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.cfar.base import MapNoise, NoiseEstimator, TrainingWindow
from dechirp.processing.spectrum import Transform

# Training and guard cells, (range, velocity), and the map about them, (velocity, range).
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


def ring_of(training, guard):
    cells = [dc.Cells(range=r, velocity=v) for r, v in (training, guard)]
    return TrainingWindow(n_training=cells[0], n_guard=cells[1])


def map_of(shape, rng):
    """Noise, with a step of clutter, a ridge and a target."""
    power = rng.exponential(size=shape).astype(np.float32)
    power[:, shape[1] // 2 :] *= 30
    power[shape[0] // 3] *= 10
    power[shape[0] // 2, shape[1] // 4] = 1e6
    return power


def training_cells(power, v, j, ring):
    """Training cells of one cell, and where they are from it, cell by cell."""
    n_v, n_r = power.shape
    start = min(max(j - ring.half_range, 0), n_r - 1 - 2 * ring.half_range)
    cells, offsets = [], []
    for row in range(start, start + 2 * ring.half_range + 1):
        for dv in range(-ring.half_velocity, ring.half_velocity + 1):
            if abs(row - j) > ring.n_guard.range or abs(dv) > ring.n_guard.velocity:
                cells.append(power[(v + dv) % n_v, row])
                offsets.append((dv, row - j))
    return np.array(cells), np.array(offsets)


def fits(estimator, ring):
    try:
        estimator.check_enough_training_cells(ring)
    except dc.InvalidSetting:
        return False
    return True


CASES = [
    pytest.param(member(), *window, id=f"{kind}, {name}")
    for kind, member in NoiseEstimator.members().items()
    for name, window in WINDOWS.items()
    if fits(member(), ring_of(*window[:2]))
]


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), CASES)
def test_thresholds_are_the_factor_times_the_statistic_of_each_ring(
    estimator, training, guard, shape
):
    ring, rng = ring_of(training, guard), np.random.default_rng(301)
    power = map_of(shape, rng)
    factors = rng.uniform(0.5, 3, shape[1]).astype(np.float32)
    found = estimator.threshold(power, ring, factors)

    expected = np.empty(shape)
    for v, j in np.ndindex(shape):
        expected[v, j] = factors[j] * estimator.statistic(*training_cells(power, v, j, ring))
    assert found.dtype == np.float32
    # Sums of up to 700 single-precision cells.
    np.testing.assert_allclose(found, expected, rtol=5e-6)

    at = np.argwhere(rng.uniform(size=shape) < 0.3)
    some = estimator.threshold_at_cells(power, at, ring, factors)
    np.testing.assert_allclose(some, found[at[:, 0], at[:, 1]], rtol=5e-6)


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), CASES)
def test_a_cell_exceeds_when_its_power_is_over_its_threshold(estimator, training, guard, shape):
    ring, rng = ring_of(training, guard), np.random.default_rng(302)
    for factor in (0.7, 1.5, 6.0):
        power = map_of(shape, rng)
        factors = (factor * rng.uniform(0.9, 1.1, shape[1])).astype(np.float32)
        mask = estimator.exceeds_threshold(power, ring, factors)

        assert mask.dtype == bool and mask.any() and not mask.all()
        assert (mask == (power > estimator.threshold(power, ring, factors))).all()
        # 2^k times stronger in every cell, the same cells are over threshold: to the last bit.
        assert (estimator.exceeds_threshold(power * 1024, ring, factors) == mask).all()


@pytest.mark.parametrize(("estimator", "training", "guard", "shape"), CASES)
@pytest.mark.parametrize("level", [0.0, 3.7])
def test_a_constant_map_has_its_own_level_and_no_detections(
    estimator, training, guard, shape, level
):
    ring = ring_of(training, guard)
    power = np.full(shape, level, np.float32)
    ones = np.ones(shape[1], np.float32)
    np.testing.assert_allclose(estimator.threshold(power, ring, ones), level, rtol=5e-6)
    assert not estimator.exceeds_threshold(power, ring, 1.01 * ones).any()


@pytest.mark.parametrize("kind", NoiseEstimator.members())
def test_where_the_training_cells_are_is_the_same_for_maps_and_for_laws(kind):
    estimator = NoiseEstimator.members()[kind]()
    white = Transform(window="rectangular", n_points=64, n_bins=64)
    noise = MapNoise(range_transform=white, doppler_transform=white)
    for training, guard, _ in WINDOWS.values():
        ring = ring_of(training, guard)
        if not fits(estimator, ring):
            continue
        for place in {0, ring.half_range // 2, ring.half_range}:
            box = ring.noise_covariance_in_box(noise, place)
            assert (box.offsets == ring.training_cell_offsets(place)).all()
            sets = estimator.subsets_causing_false_alarms(box.offsets)
            assert sets.shape[1] == box.n_training and sets.any(axis=1).all()
            # In cells that are all alike a law is about one factor and no other.
            alarms_more, alarms_less = (
                estimator.threshold_factor(pfa, box, n_channels=1).value for pfa in (1e-2, 1e-3)
            )
            assert 0 < alarms_more < alarms_less
