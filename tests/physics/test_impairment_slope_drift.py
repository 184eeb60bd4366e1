"""A slope that drifts: ranges drift with it, chirp by chirp and frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.simulation.impairments.slope_drift import SlopeDrift

STILL = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])


def test_each_frame_is_that_of_its_own_slope(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=0.1))
    drift = SlopeDrift(relative_drift=0.01)
    cube = dc.simulate(STILL, radar, impairments=[drift], n_frames=3, dtype=np.complex128)

    chirp = radar.frame.chirp
    for index, m in [(0, 0), (1, 0), (2, 0), (2, 127)]:
        slope = chirp.slope_hz_per_s * (1 + 0.01 * (index * 0.1 + m * radar.frame.interval_s))
        steeper = replace(chirp, slope_hz_per_s=slope)
        other = replace(radar, frame=replace(radar.frame, chirp=steeper))
        expected = dc.simulate(STILL, other, impairments=(), dtype=np.complex128).values[0, m]
        expected *= chirp.wavelength_m / steeper.wavelength_m
        # What rings from the ends of the window.
        assert abs(cube.values[index, m] - expected).max() < 1e-3 * abs(expected).max()


def test_the_range_drifts_by_the_range_times_the_drift(radar):
    radar = replace(radar, frame=replace(radar.frame, n_chirps=8, period_s=1.0))
    cube = dc.simulate(
        STILL, radar, impairments=[SlopeDrift(relative_drift=8e-4)], n_frames=4, dtype=np.complex128
    )

    turns = np.unwrap(np.angle(cube.values[:, 0, 0]), axis=-1)
    beat_hz = np.polyfit(np.arange(256) / 10e6, turns.T, 1)[0] / (2 * np.pi)
    range_m = [radar.frame.chirp.range_m(float(f)) for f in beat_hz]

    np.testing.assert_allclose(np.diff(range_m), 40 * 8e-4, rtol=1e-3)


def test_a_drift_beyond_the_band_of_the_samples_warns(radar):
    slow = replace(radar, frame=replace(radar.frame, interval_s=1.0))
    with pytest.warns(dc.PhysicsWarning, match="impairments.slope-drift: frequency errors"):
        SlopeDrift(relative_drift=0.1).check(STILL, slow)


def test_a_drift_that_is_too_large_only_later_warns_once_in_that_frame(radar):
    # 0.6 GHz times 0.01 a second, an eighth of 512 MHz or 2.5 MHz: too large after 0.42 s.
    late = replace(radar, frame=replace(radar.frame, n_chirps=2, period_s=0.1))
    with pytest.warns(dc.PhysicsWarning, match="slope-drift: frequency errors up to 3 MHz") as told:
        dc.simulate(STILL, late, impairments=[SlopeDrift(relative_drift=0.01)], n_frames=8)
    assert len(told) == 1


@pytest.mark.parametrize("wrong", [np.nan, 2.0, "fast"])
def test_what_is_no_drift_is_refused(wrong):
    with pytest.raises(InvalidSetting, match="relative_drift"):
        SlopeDrift(relative_drift=wrong)
