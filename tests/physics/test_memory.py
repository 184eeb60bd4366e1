"""No step of the chain holds more than three times what it is given."""

import tracemalloc

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from looks import line, rectangle, snapshots, turns
from noise import noise_cube

MIB = 2**20
POWER = np.random.default_rng(821).exponential(size=(128, 2200)).astype(np.float32)


def peak_bytes(work):
    work()  # tables and compiled code
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", [*NoiseEstimator.members()])
def test_thresholds_and_masks_hold_three_maps(kind):
    estimator = NoiseEstimator.members()[kind]()
    ring = TrainingWindow(
        n_training=dc.Cells(range=10, velocity=8), n_guard=dc.Cells(range=4, velocity=4)
    )
    factors = np.full(2200, 10.0, np.float32)
    for work in (estimator.threshold, estimator.exceeds_threshold):
        held = peak_bytes(lambda work=work: work(POWER, ring, factors))
        assert held < 3 * POWER.nbytes


# Of 1,000 detections at 192 channels covariances would take 295 MB.
@pytest.mark.parametrize("array", [line(192), rectangle(16, 12)], ids=["line", "rectangle"])
@pytest.mark.parametrize("kind", ["capon", "esprit", "fft", "iterative-adaptive", "music"])
def test_directions_of_many_detections_take_bounded_memory(kind, array):
    rng = np.random.default_rng(822)
    n = 30 if kind == "iterative-adaptive" else 1000
    x = snapshots(array, turns((n, 1, 1), rng), 0.01, rng, rng.uniform(-0.8, 0.8, (n, 1)))
    estimator = DirectionEstimator.members()[kind]()
    held = peak_bytes(lambda: estimator.find_directions(x, array, np.full(n, 0.01)))
    print(f"{kind}: {held / MIB:.0f} MiB over {x.nbytes / MIB:.1f}")
    assert held < 3 * x.nbytes + 64 * MIB


def test_a_frame_is_detected_in_three_cubes(reference):
    radar = reference.radar
    cube = noise_cube(radar, np.random.default_rng(823))
    assert peak_bytes(lambda: dc.detect(cube, radar)) < 3 * cube.nbytes
