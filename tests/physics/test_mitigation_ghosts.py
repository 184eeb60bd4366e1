"""Ghosts of other radars with the same ramps are told by how fast they go through range."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.processing.quality.synchronous_interference import find_ghost_track, ghost_findings
from dechirp.simulation.impairments.interference import Interference, Interferer
from noise import noise_cube


def other(clock, **fields):
    """A radar with the ramps of the victim, 40 m ahead, whose clock is slow by a part of one."""
    given = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 20e12,
        "ramp_duration_s": 30e-6,
        "interval_s": 35e-6 * (1 + clock),
        "transmit_power_w": 0.001,
        "antenna_gain": 4.0,
        "position_m": (40.0, 0.0, 0.0),
    }
    return Interference(interferers=[Interferer(**(given | fields))])


def has_none(found):
    return np.isnan(found.velocity_m_per_s) and found.first_chirp == -1


def walks_of(samples, radar):
    """What is found in one frame, (chirp, rx, sample)."""
    lost = ~samples.any(axis=(1, 2))
    return find_ghost_track(
        samples, lost, radar.frame.for_frame(0), float(abs(samples.view(np.float32)).max())
    )


def seen(radar, targets=(), impairments=(), seed=1):
    scene = dc.Scene(targets=list(targets))
    return dc.simulate(
        scene, radar, impairments=[*impairments, dc.impairments.ThermalNoise()], seed=seed
    )


def target(range_m, velocity, rcs_m2=10.0):
    return dc.Target(
        name=f"{range_m}/{velocity}",
        position_m=(range_m, 0, 0),
        velocity_m_per_s=(velocity, 0, 0),
        rcs_m2=rcs_m2,
    )


@pytest.mark.parametrize("coherent", [True, False])
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("clock", [3e-6, -3e-6, 6.7e-6, 20e-6])
def test_a_ghost_walks_by_half_of_light_times_the_difference_of_the_clocks(
    radar, clock, sampling, coherent
):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    street = [target(11.0, 0.0, 100.0), target(25.0, 9.0)]
    start_s = 100e-9 if clock < 0 else 0.0
    samples = seen(radar, street, [other(clock, coherent=coherent, offset_s=start_s)]).values[0]
    found = walks_of(samples, radar)

    # Beats 30 dB over the noise, to 0.03 of a cell in each of 128 chirps: 1 m/s; and what the
    # street's 20 dB less add.
    assert found.velocity_m_per_s == pytest.approx(SPEED_OF_LIGHT / 2 * clock, abs=6)
    way_m = (40.0 + SPEED_OF_LIGHT * start_s) / 2
    assert found.range_m == pytest.approx(way_m, abs=0.3)
    in_range = int(min(127, (chirp.max_range_m - way_m) / abs(SPEED_OF_LIGHT / 2 * clock) / 35e-6))
    assert found.first_chirp <= 2 and found.last_chirp >= in_range - 3


def test_a_ghost_that_ends_within_the_frame_is_told_with_its_chirps(radar):
    samples = seen(radar, [target(25.0, 9.0, 0.1)], [other(8e-6, n_chirps=70)]).values[0]
    found = walks_of(samples, radar)
    assert (found.first_chirp, found.last_chirp) == (0, pytest.approx(69, abs=2))


def test_a_ghost_is_told_among_chirps_that_are_lost_and_transmitters_that_take_turns(radar):
    frame = replace(radar.frame, n_chirps=64, multiplexing=dc.multiplexing.Tdm(order=(0, 1)))
    array = replace(radar.array, tx_m=((0, 0, 0), (0, 5e-3, 0)))
    radar = replace(radar, frame=frame, array=array)
    samples = seen(radar, [target(11.0, 0.0, 100.0)], [other(6.7e-6)]).values[0]
    samples[[3, 50, 51, 52]] = 0
    found = walks_of(samples, radar)
    assert found.velocity_m_per_s == pytest.approx(SPEED_OF_LIGHT / 2 * 6.7e-6, abs=6)


def test_among_ramps_that_fall_the_rising_ones_tell(radar):
    frame = replace(radar.frame, n_chirps=64, modulation=dc.modulations.Triangular())
    radar = replace(radar, frame=frame)
    samples = seen(radar, [target(11.0, 5.0)]).values[0]
    assert has_none(walks_of(samples, radar))
    n, m = np.arange(256), np.arange(0, 128, 2)
    cells = 60 + 1000 * frame.chirp_starts_s[::2] / frame.chirp.range_resolution_m
    tone = 1e-5 * np.exp(2j * np.pi * (cells[:, None] * n / 256 + 0.37 * m[:, None] ** 2))
    samples[::2] += tone[:, None].astype(np.complex64)
    assert walks_of(samples, radar).velocity_m_per_s == pytest.approx(1000, abs=6)


@pytest.mark.parametrize("seed", range(4))
def test_what_drives_is_no_ghost(radar, seed):
    rng = np.random.default_rng(seed)
    long = replace(radar, frame=replace(radar.frame, n_chirps=512))
    ranges_m, speeds = rng.uniform(2, 70, 40), rng.uniform(-26, 26, 40)
    places = zip(ranges_m, speeds, 10.0 ** rng.uniform(-1, 2, 40), strict=True)
    many = [target(*place) for place in places]
    for targets in ([], many[:1], many[:2], many):
        assert has_none(walks_of(seen(long, targets, seed=seed).values[0], long))


def test_the_fastest_car_is_no_ghost_and_a_clock_a_part_in_a_million_off_is_not_told(radar):
    quick = replace(radar, frame=replace(radar.frame, n_chirps=1024))
    frame = quick.frame
    n, since_s = np.arange(frame.chirp.n_samples), frame.chirp_starts_s
    for speed, is_ghost in ((100.0, False), (-140.0, False), (160.0, True), (-200.0, True)):
        cells = 60 + speed * since_s / frame.chirp.range_resolution_m
        samples = noise_cube(quick, np.random.default_rng(5)).values[0]
        tone = 3 * np.exp(2j * np.pi * cells[:, None] * n / n.size + 2j * np.cumsum(cells)[:, None])
        samples += tone[:, None].astype(np.complex64)
        assert np.isfinite(walks_of(samples, quick).velocity_m_per_s) == is_ghost


def test_targets_that_fade_one_into_another_are_no_ghost(radar):
    # Four of them, four cells apart, each the strongest for a quarter of the frame.
    n, m = np.arange(256), np.arange(128)
    samples = noise_cube(radar, np.random.default_rng(6)).values[0]
    for k in range(4):
        size = 30 * np.exp(-(((m - 16 - 32 * k) / 20) ** 2))
        tone = size[:, None] * np.exp(2j * np.pi * ((40 + 4 * k) * n / 256 + 0.21 * m[:, None]))
        samples += tone[:, None].astype(np.complex64)
    assert has_none(walks_of(samples, radar))


def test_noise_has_no_ghosts(radar):
    rng = np.random.default_rng(7)
    few = replace(
        radar,
        frame=replace(radar.frame, n_chirps=32, chirp=replace(radar.frame.chirp, n_samples=32)),
        array=dc.Array(rx_m=[(0, 0, 0)]),
    )
    assert all(has_none(walks_of(noise_cube(few, rng).values[0], few)) for _ in range(300))


def test_the_finding_names_frame_chirps_and_clock(radar):
    measures = xr.Dataset(
        {
            "walk_velocity": ("frame", [np.nan, 1004.3, 990.0]),
            "walk_range": ("frame", [np.nan, 25.52, 30.0]),
            "walk_chirps": (("frame", "end"), [[-1, -1], [0, 101], [4, 60]]),
        }
    )
    (found,) = ghost_findings(RecordingMeasures(measures=measures, radar=radar))
    assert found.level == "warning" and found.setting == "recording.ghost"
    assert "+1004 m/s, from 25.52 m on, in chirps 0 to 101 of frame 1" in found.value
    assert "in frames 1 to 2" in found.value
    assert "6.7 parts in 1e6" in found.fix
    assert ghost_findings(RecordingMeasures(measures=measures.isel(frame=[0]), radar=radar)) == []
