"""Synchronous interference: ghosts of radars with equal ramps, found by their range drift."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.processing.quality.synchronous_interference import (
    find_ghost_track,
    interference_ghost_findings,
)
from dechirp.simulation.impairments.interference import Interference, Interferer
from noise_cubes import simulate_noise_cube


def build_synchronous_interferer(clock_offset, **fields):
    """Build a radar with the ramps of the victim, 40 m ahead, with a relative clock offset."""
    settings = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 20e12,
        "ramp_duration_s": 30e-6,
        "interval_s": 35e-6 * (1 + clock_offset),
        "transmit_power_w": 0.001,
        "antenna_gain": 4.0,
        "position_m": (40.0, 0.0, 0.0),
    }
    return Interference(interferers=[Interferer(**(settings | fields))])


def has_no_ghost(track):
    return np.isnan(track.velocity_m_per_s) and track.first_chirp == -1


def find_track(samples, radar):
    """Find the ghost track of one frame, (chirp, rx, sample)."""
    is_lost = ~samples.any(axis=(1, 2))
    return find_ghost_track(
        samples, is_lost, radar.frame.for_frame(0), float(abs(samples.view(np.float32)).max())
    )


def simulate_cube(radar, targets=(), impairments=(), seed=1):
    scene = dc.Scene(targets=list(targets))
    return dc.simulate(
        scene, radar, impairments=[*impairments, dc.impairments.ThermalNoise()], seed=seed
    )


def build_target(range_m, velocity, rcs_m2=10.0):
    return dc.Target(
        name=f"{range_m}/{velocity}",
        position_m=(range_m, 0, 0),
        velocity_m_per_s=(velocity, 0, 0),
        rcs_m2=rcs_m2,
    )


@pytest.mark.parametrize("coherent", [True, False])
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("clock_offset", [3e-6, -3e-6, 6.7e-6, 20e-6])
def test_ghost_velocity_is_half_c_times_clock_offset(radar, clock_offset, sampling, coherent):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    street = [build_target(11.0, 0.0, 100.0), build_target(25.0, 9.0)]
    start_s = 100e-9 if clock_offset < 0 else 0.0
    samples = simulate_cube(
        radar,
        street,
        [build_synchronous_interferer(clock_offset, coherent=coherent, offset_s=start_s)],
    ).values[0]
    track = find_track(samples, radar)

    # Beats 30 dB over the noise have errors of 0.03 cells in each of 128 chirps: 1 m/s. Targets
    # 20 dB weaker add the rest.
    assert track.velocity_m_per_s == pytest.approx(SPEED_OF_LIGHT / 2 * clock_offset, abs=6)
    ghost_range_m = (40.0 + SPEED_OF_LIGHT * start_s) / 2
    assert track.range_m == pytest.approx(ghost_range_m, abs=0.3)
    last_visible_chirp = int(
        min(
            127,
            (chirp.max_range_m - ghost_range_m) / abs(SPEED_OF_LIGHT / 2 * clock_offset) / 35e-6,
        )
    )
    assert track.first_chirp <= 2 and track.last_chirp >= last_visible_chirp - 3


def test_finds_last_chirp_of_ghost_that_ends_within_frame(radar):
    samples = simulate_cube(
        radar, [build_target(25.0, 9.0, 0.1)], [build_synchronous_interferer(8e-6, n_chirps=70)]
    ).values[0]
    track = find_track(samples, radar)
    assert (track.first_chirp, track.last_chirp) == (0, pytest.approx(69, abs=2))


def test_finds_ghost_despite_lost_chirps_and_tdm(radar):
    frame = replace(radar.frame, n_chirps=64, multiplexing=dc.multiplexing.Tdm(order=(0, 1)))
    array = replace(radar.array, tx_m=((0, 0, 0), (0, 5e-3, 0)))
    radar = replace(radar, frame=frame, array=array)
    samples = simulate_cube(
        radar, [build_target(11.0, 0.0, 100.0)], [build_synchronous_interferer(6.7e-6)]
    ).values[0]
    samples[[3, 50, 51, 52]] = 0
    track = find_track(samples, radar)
    assert track.velocity_m_per_s == pytest.approx(SPEED_OF_LIGHT / 2 * 6.7e-6, abs=6)


def test_triangular_frame_is_searched_on_rising_ramps(radar):
    frame = replace(radar.frame, n_chirps=64, modulation=dc.modulations.Triangular())
    radar = replace(radar, frame=frame)
    samples = simulate_cube(radar, [build_target(11.0, 5.0)]).values[0]
    assert has_no_ghost(find_track(samples, radar))
    n, m = np.arange(256), np.arange(0, 128, 2)
    cells = 60 + 1000 * frame.chirp_starts_s[::2] / frame.chirp.range_resolution_m
    tone = 1e-5 * np.exp(2j * np.pi * (cells[:, None] * n / 256 + 0.37 * m[:, None] ** 2))
    samples[::2] += tone[:, None].astype(np.complex64)
    assert find_track(samples, radar).velocity_m_per_s == pytest.approx(1000, abs=6)


@pytest.mark.parametrize("seed", range(4))
def test_moving_targets_are_not_ghosts(radar, seed):
    rng = np.random.default_rng(seed)
    long_radar = replace(radar, frame=replace(radar.frame, n_chirps=512))
    ranges_m, speeds = rng.uniform(2, 70, 40), rng.uniform(-26, 26, 40)
    target_settings = zip(ranges_m, speeds, 10.0 ** rng.uniform(-1, 2, 40), strict=True)
    moving_targets = [build_target(*place) for place in target_settings]
    for targets in ([], moving_targets[:1], moving_targets[:2], moving_targets):
        assert has_no_ghost(
            find_track(simulate_cube(long_radar, targets, seed=seed).values[0], long_radar)
        )


def test_ghost_velocity_threshold_lies_between_140_and_160_m_per_s(radar):
    long_radar = replace(radar, frame=replace(radar.frame, n_chirps=1024))
    frame = long_radar.frame
    n, since_s = np.arange(frame.chirp.n_samples), frame.chirp_starts_s
    for speed, is_ghost in ((100.0, False), (-140.0, False), (160.0, True), (-200.0, True)):
        cells = 60 + speed * since_s / frame.chirp.range_resolution_m
        samples = simulate_noise_cube(long_radar, np.random.default_rng(5)).values[0]
        tone = 3 * np.exp(2j * np.pi * cells[:, None] * n / n.size + 2j * np.cumsum(cells)[:, None])
        samples += tone[:, None].astype(np.complex64)
        assert np.isfinite(find_track(samples, long_radar).velocity_m_per_s) == is_ghost


def test_targets_fading_one_after_another_are_not_ghost(radar):
    # Four targets, four cells apart, each the strongest for a quarter of the frame.
    n, m = np.arange(256), np.arange(128)
    samples = simulate_noise_cube(radar, np.random.default_rng(6)).values[0]
    for k in range(4):
        size = 30 * np.exp(-(((m - 16 - 32 * k) / 20) ** 2))
        tone = size[:, None] * np.exp(2j * np.pi * ((40 + 4 * k) * n / 256 + 0.21 * m[:, None]))
        samples += tone[:, None].astype(np.complex64)
    assert has_no_ghost(find_track(samples, radar))


def test_noise_has_no_ghosts(radar):
    rng = np.random.default_rng(7)
    small_radar = replace(
        radar,
        frame=replace(radar.frame, n_chirps=32, chirp=replace(radar.frame.chirp, n_samples=32)),
        array=dc.Array(rx_m=[(0, 0, 0)]),
    )
    assert all(
        has_no_ghost(find_track(simulate_noise_cube(small_radar, rng).values[0], small_radar))
        for _ in range(300)
    )


def test_finding_gives_frame_chirps_and_clock_offset(radar):
    measures = xr.Dataset(
        {
            "walk_velocity": ("frame", [np.nan, 1004.3, 990.0]),
            "walk_range": ("frame", [np.nan, 25.52, 30.0]),
            "walk_chirps": (("frame", "end"), [[-1, -1], [0, 101], [4, 60]]),
        }
    )
    (track,) = interference_ghost_findings(RecordingMeasures(measures=measures, radar=radar))
    assert track.level == "warning" and track.setting == "recording.ghost"
    assert "+1004 m/s, from 25.52 m on, in chirps 0 to 101 of frame 1" in track.value
    assert "in frames 1 to 2" in track.value
    assert "6.7 parts in 1e6" in track.fix
    assert (
        interference_ghost_findings(
            RecordingMeasures(measures=measures.isel(frame=[0]), radar=radar)
        )
        == []
    )
