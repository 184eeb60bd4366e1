"""Errors of velocities due to a drift of phase that static echoes show."""

from dataclasses import replace

import numpy as np
import pytest
from test_chain_fitting import RADAR, VELOCITY_CELL, make_cube

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.velocity_drift import velocity_drift_m_per_s, widen_velocity_errors
from dechirp.radar.cube import label_cube

N_FRAMES = 24
FRAME = RADAR.frame
WAVELENGTH_M = SPEED_OF_LIGHT / FRAME.chirp.mean_sampled_frequency_hz
STATIC = (20.0, 0, 70), (40.0, 0, 66), (60.0, 0, 62), (80.0, 0, 58)


def make_drifting_cube(drift_mrad, *tones, seed=1):
    """Make frames whose phases drift by normal amounts over a frame, common to all echoes."""
    rng = np.random.default_rng(seed)
    drift = 1e-3 * drift_mrad * rng.standard_normal(N_FRAMES)
    turns = np.arange(FRAME.n_chirps) / FRAME.n_chirps
    frames = [
        make_cube(*tones, seed=[seed, number]).values[0]
        * np.exp(1j * amount * turns)[:, None, None]
        for number, amount in enumerate(drift)
    ]
    return label_cube(np.array(frames, np.complex64), RADAR, units="1")


def detect_columns(cube):
    detections = dc.detect(cube, RADAR)
    return {
        name: detections[name].values for name in ("frame", "range", "velocity", "velocity_std")
    }


def rms_of_standardised_velocities(columns):
    return np.sqrt(np.mean((columns["velocity"] / columns["velocity_std"]) ** 2))


def test_common_drift_widens_the_errors_of_static_echoes():
    drift_mrad = 5.0
    columns = detect_columns(make_drifting_cube(drift_mrad, *STATIC))
    assert rms_of_standardised_velocities(columns) > 2.5

    drift_m_per_s = velocity_drift_m_per_s(columns, RADAR)

    # phi lambda / (4 pi T); the RMS of 24 normal drifts varies by 14 %, five times which is 0.7.
    expected = 1e-3 * drift_mrad * WAVELENGTH_M / (4 * np.pi * FRAME.duration_s)
    assert drift_m_per_s == pytest.approx(expected, rel=0.7)
    widened = widen_velocity_errors(columns, drift_m_per_s)
    # The variance is estimated from the same velocities; that of weak echoes is noise.
    assert 0.7 < rms_of_standardised_velocities(widened) < 1.3


def test_drift_of_each_echo_widens_the_errors():
    rng = np.random.default_rng(2)
    n = 4 * N_FRAMES
    std = np.full(n, 1e-4)
    columns = {
        "frame": np.repeat(np.arange(N_FRAMES), 4),
        "range": np.tile([2.0, 4.0, 6.0, 8.0], N_FRAMES),
        "velocity": rng.normal(size=n) * 4e-4,
        "velocity_std": std,
    }

    # Median of 96 squares: 11 % of the variance, 5 % of its root; five times which is 0.27.
    assert velocity_drift_m_per_s(columns, RADAR) == pytest.approx(np.sqrt(15) * 1e-4, rel=0.27)


def test_noise_alone_is_no_drift():
    rng = np.random.default_rng(3)
    n_drifts = 0
    for n_frames in [1] * 200 + [20] * 200:
        n = 4 * n_frames
        std = 10 ** rng.uniform(-5, -3, n)
        columns = {
            "frame": np.repeat(np.arange(n_frames), 4),
            "range": np.tile([2.0, 4.0, 6.0, 8.0], n_frames),
            "velocity": rng.normal(size=n) * std,
            "velocity_std": std,
        }
        n_drifts += velocity_drift_m_per_s(columns, RADAR) > 0

    # Stated: once in a thousand. Seven of 400 are less likely than 1e-6 (Poisson, mean 0.4).
    assert n_drifts < 7


def test_slow_target_is_no_drift():
    cube = make_drifting_cube(0.0, *STATIC[1:], (100.0, 0.05, 70))

    assert velocity_drift_m_per_s(detect_columns(cube), RADAR) < 0.01 * VELOCITY_CELL


def test_run_of_recording_states_drift(tmp_path):
    cube = make_drifting_cube(20.0, *STATIC)
    path = tmp_path / "capture.h5"
    dc.write(dc.recording_from_cube(cube, RADAR), path)

    result = dc.run(dc.Scenario(recording=RecordingSource(path=str(path))))

    (note,) = (f for f in result.findings if "static echoes have velocities" in f.value)
    assert note.level == "note"
    detections = result.detections
    z = detections.velocity.values / detections.velocity_std.values
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3


def test_single_chirps_have_no_drift():
    radar = replace(RADAR, frame=replace(FRAME, n_chirps=1))
    columns = {name: np.full(3, np.nan) for name in ("velocity", "velocity_std")}
    columns |= {"frame": np.zeros(3), "range": np.arange(3.0)}

    assert velocity_drift_m_per_s(columns, radar) == 0
