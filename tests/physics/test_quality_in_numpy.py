"""Quality measures of NumPy for small recordings, compared with those of compiled loops."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.compiled_kernels import (
    compiled_kernels_for_large_work,
    plain_twins_for_small_work,
)
from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import QualityMeasurer
from radars import street_radar


def simulate_faulty_frames(sampling, n_tx):
    """Simulate moving and static targets, with bursts, a lost and an outlier chirp, as codes."""
    radar = street_radar(n_samples=96, n_chirps=32)
    chirp = replace(radar.frame.chirp, sampling=sampling)
    multiplexing = dc.multiplexing.Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None
    array = dc.Array(
        tx_m=[(0, 7.6e-3 * n, 0) for n in range(n_tx)], rx_m=[(0, 1.9e-3 * n, 0) for n in range(3)]
    )
    frame = replace(radar.frame, chirp=chirp, multiplexing=multiplexing)
    radar = replace(radar, frame=frame, array=array)
    targets = [
        dc.Target(name="moving", position_m=(9, 1, 0), velocity_m_per_s=(-6, 0, 0), rcs_m2=3),
        dc.Target(name="static", position_m=(5, 0, 0), rcs_m2=30),
    ]
    samples = dc.simulate(dc.Scene(targets=targets), radar, n_frames=2, seed=1).values
    largest = abs(samples).max()
    samples = samples / largest / 2
    rng = np.random.default_rng(2)
    samples[:, 5, :, 30:34] += 0.2 * rng.standard_normal((2, 3, 4))
    samples[1, 20] *= 10
    step = 2.0**-11
    parts = samples.view(samples.real.dtype)
    parts[:] = np.round(parts / step) * step
    is_lost = np.zeros((2, samples.shape[1]), bool)
    is_lost[0, 11], samples[0, 11] = True, 0
    return samples, is_lost, radar


def measure(samples, is_lost, radar):
    measurer = QualityMeasurer(radar, n_frames=len(samples))
    for number, frame in enumerate(samples):
        measurer.add_frame(frame, is_lost[number], radar.frame.frame_start_s(number))
    return measurer.joined_measures("full scale")


@pytest.mark.parametrize(("sampling", "n_tx"), [("complex", 1), ("complex", 2), ("real", 1)])
def test_measures_in_numpy_equal_compiled_ones(sampling, n_tx):
    samples, is_lost, radar = simulate_faulty_frames(sampling, n_tx)
    with compiled_kernels_for_large_work(np.inf):
        expected = measure(samples, is_lost, radar)
    with plain_twins_for_small_work(0):
        measures = measure(samples, is_lost, radar)

    assert float(expected["burst"][0, 5]) > 1
    assert float(expected["unlike"][1, 20]) > 1
    # Sums of single-precision numbers in another order; kurtosis has fourth powers of them.
    xr.testing.assert_allclose(measures, expected, rtol=1e-3)
    for name in ("level", "count", "lost", "n_numbers", "step"):
        if name in expected:
            assert np.array_equal(measures[name], expected[name])
    kinds = [
        [(f.level, f.setting) for f in recording_findings(m, radar)] for m in (measures, expected)
    ]
    assert kinds[0] == kinds[1] != []
