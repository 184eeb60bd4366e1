"""Examples of micro-Doppler, multipath, rain and interference: effects that they promise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.theory.attenuation import rain_db_per_km
from nightly import nightly

EXAMPLES = Path(dc.__file__).parents[2] / "examples"
LIGHT_SPEED_M_PER_S = 299_792_458.0


def convert_to_decibels(power):
    return 10 * np.log10(power)


def load_example(name: str) -> dc.Scenario:
    return dc.load(EXAMPLES / f"{name}.yaml")


def simulate_example(scenario: dc.Scenario, **changes):
    """Simulate the cube of an example with changed scene or impairments."""
    scenario = replace(scenario, **changes)
    return dc.simulate(
        scenario.scene,
        scenario.radar,
        impairments=scenario.impairments,
        n_frames=scenario.n_frames,
        seed=scenario.seed,
    )


def compute_maps(cube, scenario: dc.Scenario) -> list:
    """Return the range-Doppler map of each frame, (velocity, range)."""
    return [
        dc.power_map(cube.isel(frame=frame), scenario.radar, scenario.chain)
        for frame in range(cube.sizes["frame"])
    ]


def select_impairments(scenario: dc.Scenario, *kinds: type) -> tuple:
    return tuple(impairment for impairment in scenario.impairments if isinstance(impairment, kinds))


# Crossing.


@pytest.fixture(scope="module")
def crossing():
    """Cube, radar and truth of 1.5 s without a gap."""
    scenario = load_example("crossing")
    return (
        simulate_example(scenario),
        scenario.radar,
        dc.truth(scenario.scene, scenario.radar, n_frames=scenario.n_frames),
    )


def compute_spectrogram(crossing, range_m, n_window, target):
    """Return times, velocities, powers (time, velocity), and target velocities at the times."""
    cube, radar, truth = crossing
    spectrum = dc.spectrogram(
        cube, radar, range_m=range_m, n_window=n_window, hop=32, n_velocity_bins=512
    )
    target_velocity = np.interp(spectrum.time, truth.time, truth.velocity.sel(target=target))
    return spectrum.time.values, spectrum.velocity.values, spectrum.values, target_velocity


@nightly
def test_pedestrian_torso_has_walking_velocity_and_feet_have_step_frequency(crossing):
    # Windows of 15 ms, 0.2 m/s wide.
    times_s, velocity, power, walking_velocity = compute_spectrogram(
        crossing, (7.5, 12.5), 100, "pedestrian"
    )

    # The torso sways by 0.4 m/s about its mean.
    strongest = velocity[power.argmax(axis=1)]
    assert np.median(strongest - walking_velocity) == pytest.approx(0, abs=0.1)
    assert np.percentile(abs(strongest - walking_velocity), 80) < 0.45

    # The feet are the fastest echoes, 8 dB over the noise.
    fastest = np.array([velocity[row > 6 * np.median(power)].max() for row in power])
    # One step, half a cycle, by Boulic's model with hips at 0.53 of 1.75 m.
    step_hz = 2 * np.sqrt(1.4534 / (0.53 * 1.75)) / 1.346
    candidates_hz = np.arange(1.0, 5.0, 0.02)
    waves = np.exp(-2j * np.pi * candidates_hz[:, None] * times_s)
    peak_hz = candidates_hz[abs(waves @ (fastest - fastest.mean())).argmax()]
    # Three steps.
    assert peak_hz == pytest.approx(step_hz, rel=0.04)
    for start_s in (0.2, 0.7, 1.2):
        in_step = (times_s > start_s) & (times_s < start_s + 0.32)
        # The window widens lines by 0.2 m/s.
        peak = (fastest[in_step] - 0.2).max() / walking_velocity[in_step].mean()
        assert 3 < peak < 4


@nightly
def test_bicycle_frame_is_single_doppler_line_surrounded_by_feet(crossing):
    _, velocity, power, frame_velocity = compute_spectrogram(
        crossing, (13.5, 22.5), 512, "bicyclist"
    )

    strongest = velocity[power.argmax(axis=1)]
    # Half a bin of 0.025 m/s, and the 0.02 m/s by which the truth bends between frames.
    assert strongest == pytest.approx(frame_velocity, abs=0.04)
    # Feet on pedals go up to 2 pi 0.9 Hz 0.17 m = 0.96 m/s faster or slower than the frame; only
    # points of the wheels are faster, 0.1 m^2 among 96.
    offset = abs(velocity - frame_velocity[:, None])
    floor_w = np.median(power)
    for side in (velocity > frame_velocity[:, None], velocity < frame_velocity[:, None]):
        feet, beyond = ((offset > low) & (offset < low + 0.25) & side for low in (0.7, 1.2))
        assert power[feet].max() > 10 * floor_w
        assert power[beyond].max() < 0.5 * power[feet].max()


# Guard rail.


def compute_multipath(scenario: dc.Scenario, frame: int) -> dict[str, list[tuple[float, float]]]:
    """Return range and velocity of each target: direct, one-bounce and two-bounce path."""
    (wall,) = select_impairments(scenario, dc.impairments.WallMultipath)
    time_s = scenario.radar.frame.frame_start_s(frame) + scenario.radar.frame.mid_frame_s
    ego_velocity = np.array(scenario.scene.ego.velocity_m_per_s)
    paths = {}
    for target in scenario.scene.targets:
        velocity = np.array(target.velocity_m_per_s) - ego_velocity
        straight_m = np.array(target.position_m) + velocity * time_s
        image_m = straight_m * (1, -1, 1) + (0, 2 * wall.start_m[1], 0)
        (direct, reflected) = (
            (np.linalg.norm(at_m), at_m @ velocity / np.linalg.norm(at_m))
            for at_m in (straight_m, image_m)
        )
        paths[target.name] = [direct, tuple(np.mean([direct, reflected], axis=0)), reflected]
    return paths


def is_detected(result: dc.Result, frame: int, range_velocity: tuple[float, float]) -> bool:
    """Return whether a detection lies within half a range cell and one velocity cell.

    Antennas are 5 mm off the origin.
    """
    detections, radar = result.detections, result.radar
    is_near = (
        abs(detections.range.values - range_velocity[0]) < radar.frame.chirp.range_resolution_m / 2
    )
    is_near &= (
        abs(detections.velocity.values - range_velocity[1])
        < radar.frame.velocity_resolution_m_per_s
    )
    return bool((is_near & (detections.frame.values == frame)).any())


@nightly
def test_each_motorcycle_has_two_multipath_ghosts_at_image_positions():
    scenario = load_example("guard-rail")
    result = dc.run(scenario)
    direct_result = dc.run(
        replace(scenario, impairments=select_impairments(scenario, dc.impairments.AutomotiveChip))
    )

    for frame in range(scenario.n_frames):
        for points in compute_multipath(scenario, frame).values():
            assert [is_detected(result, frame, point) for point in points] == [True] * 3
            assert [is_detected(direct_result, frame, point) for point in points] == [
                True,
                False,
                False,
            ]


# Rain.


def test_rain_attenuates_reflectors_as_p_838():
    scenario = load_example("rain")
    (rain,) = select_impairments(scenario, dc.impairments.RainAttenuation)
    clear, wet = (
        compute_maps(simulate_example(scenario, impairments=impairments), scenario)
        for impairments in ((), (rain,))
    )

    truth = dc.truth(scenario.scene, scenario.radar, n_frames=scenario.n_frames)
    frequency_hz = scenario.radar.frame.chirp.mid_window_frequency_hz
    # 30.8 dB/km, horizontally polarised.
    db_per_km = rain_db_per_km(frequency_hz, 100e-3 / 3600)
    assert db_per_km == pytest.approx(30.8, abs=0.1)
    first_db = []
    for target in scenario.scene.names:
        for frame in range(scenario.n_frames):
            range_m = truth.range.sel(target=target, frame=frame).item()
            levels = [
                frame_maps[frame].sel(range=slice(range_m - 4, range_m + 4)).max().item()
                for frame_maps in (wet, clear)
            ]
            attenuation_db = -convert_to_decibels(levels[0] / levels[1])
            assert attenuation_db == pytest.approx(2e-3 * range_m * db_per_km, abs=0.01)
            first_db += [attenuation_db] if frame == 0 else []
    # Values from the header comment of the file.
    assert first_db == pytest.approx([2.2, 5.2, 8.9], abs=0.06)


def test_rain_backscatter_is_ridge_at_ego_speed_that_falls_with_range():
    scenario = load_example("rain")
    impairments = select_impairments(
        scenario, dc.impairments.ThermalNoise, dc.impairments.RainBackscatter
    )
    road = replace(scenario.scene, targets=())
    frame_maps = compute_maps(
        simulate_example(scenario, scene=road, impairments=impairments), scenario
    )
    power = np.mean([frame_map.values for frame_map in frame_maps], axis=0)

    velocity, range_m = frame_maps[0].velocity.values, frame_maps[0].range.values
    ridge = (velocity > -22) & (velocity < -18)
    floor_w = np.median(power)
    near, far = ((range_m > low) & (range_m < 2 * low) for low in (8, 16))
    for in_range in (near, far):
        rain_w = power[ridge][:, in_range] - floor_w
        speed = (rain_w.sum(axis=1) @ velocity[ridge]) / rain_w.sum()
        # Drops fall across the line of sight, and the beam width reduces the speed by a hundredth.
        assert speed == pytest.approx(-19.9, abs=0.2)
        assert power[ridge][:, in_range].max() > 1000 * floor_w
        assert power[~ridge][:, in_range].max() < 30 * floor_w
    # The sum over an interval twice as far and twice as wide is half: 50 independent samples,
    # 0.6 dB, and 1/r^2 reduces their number.
    sums_w = [(power[ridge][:, in_range] - floor_w).sum() for in_range in (near, far)]
    assert convert_to_decibels(sums_w[0] / sums_w[1]) == pytest.approx(3, abs=2)


# Interference.


def test_crossing_interferer_is_burst_of_0_8_us_and_raises_noise_floor():
    scenario = load_example("interference")
    (interference,) = select_impairments(scenario, dc.impairments.Interference)
    crossing = replace(interference, interferers=interference.interferers[:1])
    chirp = scenario.radar.frame.chirp
    bursts = simulate_example(scenario, scene=dc.Scene(), impairments=(crossing,)).values[:, :, 0]
    power = abs(bursts) ** 2

    # The slopes differ by 25 MHz/us: a band of 20 MHz passes in 0.8 us, 16 samples.
    is_burst = power > power.max() / 4
    is_complete = (
        is_burst.any(axis=-1) & ~is_burst[..., :20].any(axis=-1) & ~is_burst[..., -20:].any(axis=-1)
    )
    burst_lengths = is_burst[is_complete].sum(axis=-1)
    assert is_complete.sum() > 100
    assert np.median(burst_lengths) / chirp.sample_rate_hz == pytest.approx(0.8e-6, abs=0.06e-6)
    # One-way propagation by Friis, 70.1 m.
    (oncoming,) = crossing.interferers
    gains = oncoming.antenna_gain * scenario.radar.hardware.antenna_gain
    spreading = (chirp.wavelength_m / (4 * np.pi * np.hypot(70, 4))) ** 2
    received_w = oncoming.transmit_power_w * gains * spreading
    level_w = np.median(power[0][is_burst[0]])
    assert convert_to_decibels(level_w / received_w) == pytest.approx(0, abs=0.2)

    # The mean power of the bursts is spread over the map.
    noise = select_impairments(scenario, dc.impairments.ThermalNoise)
    noise_cube = simulate_example(scenario, impairments=noise)
    interfered_cube = simulate_example(scenario)
    noise_w = dc.simulate(dc.Scene(), scenario.radar, impairments=noise).values
    rise_db = convert_to_decibels(1 + power[0].mean() / np.mean(abs(noise_w) ** 2))
    floors_w = [
        np.median(compute_maps(cube, scenario)[0]) for cube in (interfered_cube, noise_cube)
    ]
    assert rise_db > 6
    assert convert_to_decibels(floors_w[0] / floors_w[1]) == pytest.approx(rise_db, abs=0.5)


def test_synchronous_interferer_is_static_ghost_and_bursts_mask_motorcycle():
    scenario = load_example("interference")
    result = dc.run(scenario)
    (interference,) = select_impairments(scenario, dc.impairments.Interference)
    # Apparent range of an echo with the same path and time offset.
    interferer = interference.interferers[1]
    ghost_m = (
        np.linalg.norm(interferer.position_m) + LIGHT_SPEED_M_PER_S * interferer.offset_s
    ) / 2
    assert ghost_m == pytest.approx(45, abs=0.01)
    assert np.linalg.norm(interferer.position_m) == pytest.approx(20, abs=0.01)
    for frame in range(scenario.n_frames):
        assert is_detected(result, frame, (ghost_m, 0.0))
        car = result.truth.sel(target="car", frame=frame)
        assert is_detected(result, frame, (car.range.item(), car.velocity.item()))
    clear_result = dc.run(
        replace(scenario, impairments=select_impairments(scenario, dc.impairments.ThermalNoise))
    )
    for frame in range(scenario.n_frames):
        assert not is_detected(clear_result, frame, (ghost_m, 0.0))
        # Bursts mask the motorcycle.
        motorcycle = result.truth.sel(target="motorcycle", frame=frame)
        range_velocity = motorcycle.range.item(), motorcycle.velocity.item()
        assert [is_detected(run, frame, range_velocity) for run in (clear_result, result)] == [
            True,
            False,
        ]
