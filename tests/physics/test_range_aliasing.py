"""Ranges at the ends of the axis: the first cell of a map contains both of them."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc

CHIRP = dc.Chirp(
    start_frequency_hz=76.5e9, slope_hz_per_s=20e12, adc_start_s=2e-6, ramp_duration_s=16e-6,
    sample_rate_hz=20e6, n_samples=256, sampling="complex",
)  # fmt: skip
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=64, interval_s=20e-6),
    array=dc.Array(rx_m=[(0, 0, 0), (0, 1.95e-3, 0)]),
    hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=100.0, noise_factor=16.0),
)
CELL_M, SPAN_M = CHIRP.range_resolution_m, CHIRP.max_range_m


def detect_target(range_m, velocity_m_per_s, rcs_m2):
    """Return the detections of one target, and its true range at mid-frame."""
    scene = dc.Scene(
        targets=[
            dc.Target(
                position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), rcs_m2=rcs_m2
            )
        ]
    )
    return dc.detect(dc.simulate(scene, RADAR, seed=2), RADAR), float(
        dc.truth(scene, RADAR).range.item()
    )


@pytest.mark.parametrize("cells_below_end", [0.08, 0.1, 0.3, 0.49, 0.7])
@pytest.mark.parametrize("velocity_m_per_s", [-20.0, 0.0, 20.0])
def test_target_in_last_cell_is_not_at_negative_range(cells_below_end, velocity_m_per_s):
    range_m = SPAN_M - cells_below_end * CELL_M
    # Strong, so that three standard errors are less than a twentieth of a cell.
    detections, true_m = detect_target(range_m, velocity_m_per_s, rcs_m2=1e4)

    assert detections.sizes["detection"] == 1
    error_m = abs(detections.range.item() - true_m)
    assert error_m < 5 * detections.range_std.item() + 1e-4 * CELL_M


@pytest.mark.parametrize(
    ("cells_below_end", "velocity_m_per_s"),
    [(0.02, -5.0), (0.02, 0.0), (0.04, 0.0), (0.04, -20.0), (0.04, 20.0)],
)
def test_target_at_end_is_no_leakage(cells_below_end, velocity_m_per_s):
    range_m = SPAN_M - cells_below_end * CELL_M
    detections, true_m = detect_target(range_m, velocity_m_per_s, rcs_m2=1e5)

    assert detections.sizes["detection"] == 1
    assert 3 * detections.range_std.item() < 0.02 * CELL_M
    error_m = abs(detections.range.item() - true_m)
    assert error_m < 5 * detections.range_std.item() + 1e-4 * CELL_M


def test_approaching_target_near_the_radar_is_not_beyond_the_largest_range():
    # At 20 m/s its Doppler frequency, -10 kHz, exceeds its beat frequency.
    detections, true_m = detect_target(0.06, -20.0, rcs_m2=1e-4)

    assert (abs(detections.range - true_m) < 0.05).any()
    assert detections.range.max() < 1


def test_echo_at_range_zero_stays_there():
    radar = replace(RADAR, array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 1e-3, 0)]))
    leakage = dc.impairments.Leakage(isolation=1e5)
    for seed in range(5):
        cube = dc.simulate(
            dc.Scene(), radar, impairments=[leakage, dc.impairments.ThermalNoise()], seed=seed
        )
        assert abs(dc.detect(cube, radar).range).max() < 0.05 * CELL_M


@pytest.mark.parametrize("target_cells", [0.7, 1.0, 2.0])
def test_leakage_beside_target_is_at_neither_end(target_cells):
    # The target shifts the leakage by up to half a cell, to the largest ranges.
    radar = replace(RADAR, array=dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 1e-3, 0)]))
    leakage = dc.impairments.Leakage(isolation=1e5)
    ranges_m = []
    for seed in range(6):
        # Fractions of a wavelength: the phases of leakage and target differ from trial to trial.
        position_m = (target_cells * CELL_M + seed * 2.3e-4, 0, 0)
        target = dc.Target(position_m=position_m, rcs_m2=10.0**-seed)
        cube = dc.simulate(
            dc.Scene(targets=[target]),
            radar,
            impairments=[leakage, dc.impairments.ThermalNoise()],
            seed=seed,
        )
        ranges_m.extend(dc.detect(cube, radar).range.values)

    assert min(ranges_m) >= 0
    assert max(ranges_m) < 5 * CELL_M


def test_leakage_nearer_than_range_offset_is_at_zero():
    cube = dc.simulate(
        dc.Scene(),
        RADAR,
        impairments=[dc.impairments.Leakage(isolation=1e5), dc.impairments.ThermalNoise()],
    )
    calibration = dc.Calibration(
        elements=[(0, 0), (0, 1)], gain=[(1.0, 0.0)] * 2, range_offset_m=0.8 * CELL_M
    )

    detections = dc.detect(cube, replace(RADAR, calibration=calibration))

    assert detections.range.values.tolist() == [0.0]


def test_aliased_truth_is_never_negative():
    true_m = np.linspace(0.0, 3 * SPAN_M, 301)
    scene = dc.Scene(targets=[dc.Target(position_m=(r + 0.01, 0, 0)) for r in true_m])
    apparent = dc.scene.aliasing.apparent_range_and_velocity
    ranges_m = apparent(dc.truth(scene, RADAR), RADAR).range_m

    assert ranges_m.min() > -1e-6 * SPAN_M
    assert ranges_m.max() < SPAN_M
