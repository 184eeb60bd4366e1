"""Slope drift: range drift over chirps and frames, and findings."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.simulation.impairments.sweep_nonlinearity import SlopeDrift

STATIC_SCENE = dc.Scene(targets=[dc.Target(position_m=(40, 0, 0), rcs_m2=10)])


def test_each_chirp_has_its_drifted_slope(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=0.1))
    drift = SlopeDrift(relative_drift=0.01)
    cube = dc.simulate(STATIC_SCENE, radar, impairments=[drift], n_frames=3, dtype=np.complex128)

    chirp = radar.frame.chirp
    for index, m in [(0, 0), (1, 0), (2, 0), (2, 127)]:
        slope = chirp.slope_hz_per_s * (1 + 0.01 * (index * 0.1 + m * radar.frame.interval_s))
        steeper = replace(chirp, slope_hz_per_s=slope)
        steeper_radar = replace(radar, frame=replace(radar.frame, chirp=steeper))
        expected = dc.simulate(
            STATIC_SCENE, steeper_radar, impairments=(), dtype=np.complex128
        ).values[0, m]
        expected *= chirp.wavelength_m / steeper.wavelength_m
        # The tolerance covers ringing at the window ends.
        assert abs(cube.values[index, m] - expected).max() < 1e-3 * abs(expected).max()


def test_range_drifts_by_range_times_relative_drift(radar):
    radar = replace(radar, frame=replace(radar.frame, n_chirps=8, period_s=1.0))
    cube = dc.simulate(
        STATIC_SCENE,
        radar,
        impairments=[SlopeDrift(relative_drift=8e-4)],
        n_frames=4,
        dtype=np.complex128,
    )

    turns = np.unwrap(np.angle(cube.values[:, 0, 0]), axis=-1)
    beat_hz = np.polyfit(np.arange(256) / 10e6, turns.T, 1)[0] / (2 * np.pi)
    range_m = [radar.frame.chirp.range_m(float(f)) for f in beat_hz]

    np.testing.assert_allclose(np.diff(range_m), 40 * 8e-4, rtol=1e-3)


def test_warns_of_drift_above_sample_bandwidth(radar):
    slow_radar = replace(radar, frame=replace(radar.frame, interval_s=1.0))
    with pytest.warns(dc.PhysicsWarning, match="impairments.slope-drift: frequency errors"):
        SlopeDrift(relative_drift=0.1).check(STATIC_SCENE, slow_radar)


def test_warns_once_of_drift_that_exceeds_bandwidth_in_later_frame(radar):
    # 0.6 GHz times 0.01 per second exceeds 2.5 MHz, an eighth of 512 MHz, after 0.42 s.
    periodic_radar = replace(radar, frame=replace(radar.frame, n_chirps=2, period_s=0.1))
    with pytest.warns(
        dc.PhysicsWarning, match="slope-drift: frequency errors up to 3 MHz"
    ) as warnings:
        dc.simulate(
            STATIC_SCENE, periodic_radar, impairments=[SlopeDrift(relative_drift=0.01)], n_frames=8
        )
    assert len(warnings) == 1


@pytest.mark.parametrize("invalid_value", [np.nan, 2.0, "fast"])
def test_rejects_invalid_drift(invalid_value):
    with pytest.raises(InvalidSetting, match="relative_drift"):
        SlopeDrift(relative_drift=invalid_value)
