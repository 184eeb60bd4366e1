"""Peak memory of CFAR, direction finding and detection: at most three times the input."""

import tracemalloc

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from nightly import nightly
from noise_cubes import simulate_noise_cube
from snapshots import random_phasors, rectangular_array, simulate_snapshots, uniform_linear_array

MIB = 2**20
POWER = np.random.default_rng(821).exponential(size=(128, 2200)).astype(np.float32)


def measure_peak_bytes(work):
    work()  # first call: fills tables, compiles code
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@nightly
@pytest.mark.parametrize("kind", [*NoiseEstimator.members()])
def test_thresholds_and_masks_need_less_than_three_maps(kind):
    estimator = NoiseEstimator.members()[kind]()
    training_window = TrainingWindow(
        n_training=dc.Cells(range=10, velocity=8), n_guard=dc.Cells(range=4, velocity=4)
    )
    factors = np.full(2200, 10.0, np.float32)
    for work in (estimator.threshold, estimator.exceeds_threshold):
        n_bytes = measure_peak_bytes(lambda work=work: work(POWER, training_window, factors))
        assert n_bytes < 3 * POWER.nbytes


# Covariances of 1,000 detections at 192 channels would need 295 MB.
@nightly
@pytest.mark.parametrize(
    "array",
    [uniform_linear_array(192), rectangular_array(16, 12)],
    ids=["line", "rectangle"],
)
@pytest.mark.parametrize(
    "kind",
    ["capon", "esprit", "fft", "iterative-adaptive", "music"],
)
def test_direction_finding_needs_bounded_memory(kind, array):
    rng = np.random.default_rng(822)
    n = 30 if kind == "iterative-adaptive" else 1000
    x = simulate_snapshots(
        array, random_phasors((n, 1, 1), rng), 0.01, rng, rng.uniform(-0.8, 0.8, (n, 1))
    )
    estimator = DirectionEstimator.members()[kind]()
    n_bytes = measure_peak_bytes(lambda: estimator.find_directions(x, array, np.full(n, 0.01)))
    print(f"{kind}: {n_bytes / MIB:.0f} MiB over {x.nbytes / MIB:.1f}")
    assert n_bytes < 3 * x.nbytes + 64 * MIB


def test_detection_needs_less_than_three_cubes(reference):
    radar = reference.radar
    cube = simulate_noise_cube(radar, np.random.default_rng(823))
    assert measure_peak_bytes(lambda: dc.detect(cube, radar)) < 3 * cube.nbytes
