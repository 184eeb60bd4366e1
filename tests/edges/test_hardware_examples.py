"""The examples of hardware and roads show what their heads say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.theory.attenuation import rain_db_per_km

EXAMPLES = Path(dc.__file__).parents[2] / "examples"
LIGHT = 299_792_458.0


def decibels(power):
    return 10 * np.log10(power)


def scenario(name: str) -> dc.Scenario:
    return dc.load(EXAMPLES / f"{name}.yaml")


def simulated(made: dc.Scenario, **changes):
    """Its cube; `changes` of the scene and of the impairments."""
    made = replace(made, **changes)
    return dc.simulate(
        made.scene,
        made.radar,
        impairments=made.impairments,
        n_frames=made.n_frames,
        seed=made.seed,
    )


def maps(cube, made: dc.Scenario) -> list:
    """Range-Doppler map of each frame, (velocity, range)."""
    return [
        dc.power_map(cube.isel(frame=frame), made.radar, made.chain)
        for frame in range(cube.sizes["frame"])
    ]


def of_kind(made: dc.Scenario, *kinds: type) -> tuple:
    return tuple(one for one in made.impairments if isinstance(one, kinds))


# Crossing.


@pytest.fixture(scope="module")
def crossing():
    """The cube, the radar, and the truth: 1.5 s without a gap."""
    made = scenario("crossing")
    return simulated(made), made.radar, dc.truth(made.scene, made.radar, n_frames=made.n_frames)


def lines(crossing, range_m, n_window, target):
    """Times, velocities, powers (time, velocity), and the target's velocity at the times."""
    cube, radar, known = crossing
    found = dc.spectrogram(
        cube, radar, range_m=range_m, n_window=n_window, hop=32, n_velocity_bins=512
    )
    origin = np.interp(found.time, known.time, known.velocity.sel(target=target))
    return found.time.values, found.velocity.values, found.values, origin


def test_the_trunk_of_the_pedestrian_goes_on_and_the_feet_step_every_half_second(crossing):
    # Windows of 15 ms, 0.2 m/s wide.
    times_s, velocity, power, walking = lines(crossing, (7.5, 12.5), 100, "pedestrian")

    # The trunk sways by 0.4 m/s about its mean.
    strongest = velocity[power.argmax(axis=1)]
    assert np.median(strongest - walking) == pytest.approx(0, abs=0.1)
    assert np.percentile(abs(strongest - walking), 80) < 0.45

    # 8 dB over the noise, the feet are the fastest.
    fastest = np.array([velocity[row > 6 * np.median(power)].max() for row in power])
    # One step, half a cycle, by Boulic's model with hips at 0.53 of 1.75 m.
    step_hz = 2 * np.sqrt(1.4534 / (0.53 * 1.75)) / 1.346
    tried_hz = np.arange(1.0, 5.0, 0.02)
    waves = np.exp(-2j * np.pi * tried_hz[:, None] * times_s)
    found_hz = tried_hz[abs(waves @ (fastest - fastest.mean())).argmax()]
    # Three steps.
    assert found_hz == pytest.approx(step_hz, rel=0.04)
    for start_s in (0.2, 0.7, 1.2):
        of_step = (times_s > start_s) & (times_s < start_s + 0.32)
        # The window widens lines by 0.2 m/s.
        peak = (fastest[of_step] - 0.2).max() / walking[of_step].mean()
        assert 3 < peak < 4


def test_the_frame_of_the_bicycle_is_one_line_and_feet_turn_about_it(crossing):
    _, velocity, power, riding = lines(crossing, (13.5, 22.5), 512, "bicyclist")

    strongest = velocity[power.argmax(axis=1)]
    # Half a bin of 0.025 m/s, and the 0.02 m/s by which the truth bends between frames.
    assert strongest == pytest.approx(riding, abs=0.04)
    # Feet on pedals go up to 2 pi 0.9 Hz 0.17 m = 0.96 m/s faster or slower than the frame; all
    # that is faster are points of the wheels, 0.1 m^2 among 96.
    off = abs(velocity - riding[:, None])
    floor_w = np.median(power)
    for side in (velocity > riding[:, None], velocity < riding[:, None]):
        feet, beyond = ((off > low) & (off < low + 0.25) & side for low in (0.7, 1.2))
        assert power[feet].max() > 10 * floor_w
        assert power[beyond].max() < 0.5 * power[feet].max()


# Guard rail.


def ways(made: dc.Scenario, frame: int) -> dict[str, list[tuple[float, float]]]:
    """Of each target range and velocity: straight, off the rail one way, and both ways."""
    (wall,) = of_kind(made, dc.impairments.WallMultipath)
    time_s = made.radar.frame.frame_start_s(frame) + made.radar.frame.mid_frame_s
    own = np.array(made.scene.ego.velocity_m_per_s)
    found = {}
    for target in made.scene.targets:
        velocity = np.array(target.velocity_m_per_s) - own
        straight_m = np.array(target.position_m) + velocity * time_s
        image_m = straight_m * (1, -1, 1) + (0, 2 * wall.start_m[1], 0)
        (straight, over) = (
            (np.linalg.norm(at_m), at_m @ velocity / np.linalg.norm(at_m))
            for at_m in (straight_m, image_m)
        )
        found[target.name] = [straight, tuple(np.mean([straight, over], axis=0)), over]
    return found


def detected(result: dc.Result, frame: int, place: tuple[float, float]) -> bool:
    """Within half a cell of a range, and a cell of a velocity: antennas are 5 mm off the origin."""
    found, radar = result.detections, result.radar
    near = abs(found.range.values - place[0]) < radar.frame.chirp.range_resolution_m / 2
    near &= abs(found.velocity.values - place[1]) < radar.frame.velocity_resolution_m_per_s
    return bool((near & (found.frame.values == frame)).any())


def test_each_motorcycle_has_two_ghosts_behind_it_where_images_in_the_rail_say():
    made = scenario("guard-rail")
    result = dc.run(made)
    alone = dc.run(replace(made, impairments=of_kind(made, dc.impairments.Typical77Ghz)))

    for frame in range(made.n_frames):
        for places in ways(made, frame).values():
            assert [detected(result, frame, place) for place in places] == [True] * 3
            assert [detected(alone, frame, place) for place in places] == [True, False, False]


# Rain.


def test_rain_takes_of_the_reflectors_what_p_838_says():
    made = scenario("rain")
    (rain,) = of_kind(made, dc.impairments.RainAttenuation)
    clear, wet = (maps(simulated(made, impairments=listed), made) for listed in ((), (rain,)))

    known = dc.truth(made.scene, made.radar, n_frames=made.n_frames)
    frequency_hz = made.radar.frame.chirp.mid_window_frequency_hz
    # 30.8 dB/km, horizontally polarised.
    db_per_km = rain_db_per_km(frequency_hz, 100e-3 / 3600)
    assert db_per_km == pytest.approx(30.8, abs=0.1)
    first_db = []
    for target in made.scene.names:
        for frame in range(made.n_frames):
            range_m = known.range.sel(target=target, frame=frame).item()
            levels = [
                one[frame].sel(range=slice(range_m - 4, range_m + 4)).max().item()
                for one in (wet, clear)
            ]
            taken_db = -decibels(levels[0] / levels[1])
            assert taken_db == pytest.approx(2e-3 * range_m * db_per_km, abs=0.01)
            first_db += [taken_db] if frame == 0 else []
    # As the head of the file says.
    assert first_db == pytest.approx([2.2, 5.2, 8.9], abs=0.06)


def test_rain_is_a_ridge_at_the_speed_of_the_road_that_falls_with_range():
    made = scenario("rain")
    listed = of_kind(made, dc.impairments.ThermalNoise, dc.impairments.RainBackscatter)
    road = replace(made.scene, targets=())
    found = maps(simulated(made, scene=road, impairments=listed), made)
    power = np.mean([one.values for one in found], axis=0)

    velocity, range_m = found[0].velocity.values, found[0].range.values
    ridge = (velocity > -22) & (velocity < -18)
    floor_w = np.median(power)
    near, far = ((range_m > low) & (range_m < 2 * low) for low in (8, 16))
    for ring in (near, far):
        own_w = power[ridge][:, ring] - floor_w
        speed = (own_w.sum(axis=1) @ velocity[ridge]) / own_w.sum()
        # Drops fall across, and the beam takes a hundredth.
        assert speed == pytest.approx(-19.9, abs=0.2)
        assert power[ridge][:, ring].max() > 1000 * floor_w
        assert power[~ridge][:, ring].max() < 30 * floor_w
    # The sum over a ring twice as far and twice as wide is half: 50 looks, 0.6 dB, and 1/r^2
    # makes them fewer.
    sums_w = [(power[ridge][:, ring] - floor_w).sum() for ring in (near, far)]
    assert decibels(sums_w[0] / sums_w[1]) == pytest.approx(3, abs=2)


# Interference.


def test_a_radar_that_crosses_is_a_burst_of_0_8_us_and_raises_the_floor():
    made = scenario("interference")
    (both,) = of_kind(made, dc.impairments.Interference)
    crossing = replace(both, interferers=both.interferers[:1])
    chirp = made.radar.frame.chirp
    burst = simulated(made, scene=dc.Scene(), impairments=(crossing,)).values[:, :, 0]
    power = abs(burst) ** 2

    # The slopes part by 25 MHz/us: a band of 20 MHz passes in 0.8 us, 16 samples.
    heard = power > power.max() / 4
    whole = heard.any(axis=-1) & ~heard[..., :20].any(axis=-1) & ~heard[..., -20:].any(axis=-1)
    n_heard = heard[whole].sum(axis=-1)
    assert whole.sum() > 100
    assert np.median(n_heard) / chirp.sample_rate_hz == pytest.approx(0.8e-6, abs=0.06e-6)
    # One way by Friis, 70.1 m.
    (oncoming,) = crossing.interferers
    gains = oncoming.antenna_gain * made.radar.hardware.antenna_gain
    spreading = (chirp.wavelength_m / (4 * np.pi * np.hypot(70, 4))) ** 2
    received_w = oncoming.transmit_power_w * gains * spreading
    level_w = np.median(power[0][heard[0]])
    assert decibels(level_w / received_w) == pytest.approx(0, abs=0.2)

    # What bursts have on average is spread over the map.
    noise = of_kind(made, dc.impairments.ThermalNoise)
    quiet = simulated(made, impairments=noise)
    loud = simulated(made)
    noise_w = dc.simulate(dc.Scene(), made.radar, impairments=noise).values
    rise_db = decibels(1 + power[0].mean() / np.mean(abs(noise_w) ** 2))
    floors_w = [np.median(maps(cube, made)[0]) for cube in (loud, quiet)]
    assert rise_db > 6
    assert decibels(floors_w[0] / floors_w[1]) == pytest.approx(rise_db, abs=0.5)


def test_a_radar_that_is_alike_is_a_ghost_at_45_m_at_rest_and_a_motorcycle_drowns():
    made = scenario("interference")
    result = dc.run(made)
    (both,) = of_kind(made, dc.impairments.Interference)
    # Its way and its lead, as an echo.
    alike = both.interferers[1]
    ghost_m = (np.linalg.norm(alike.position_m) + LIGHT * alike.offset_s) / 2
    assert ghost_m == pytest.approx(45, abs=0.01)
    assert np.linalg.norm(alike.position_m) == pytest.approx(20, abs=0.01)
    for frame in range(made.n_frames):
        assert detected(result, frame, (ghost_m, 0.0))
        car = result.truth.sel(target="car", frame=frame)
        assert detected(result, frame, (car.range.item(), car.velocity.item()))
    without = dc.run(replace(made, impairments=of_kind(made, dc.impairments.ThermalNoise)))
    for frame in range(made.n_frames):
        assert not detected(without, frame, (ghost_m, 0.0))
        # Bursts drown the motorcycle.
        small = result.truth.sel(target="motorcycle", frame=frame)
        place = small.range.item(), small.velocity.item()
        assert [detected(one, frame, place) for one in (without, result)] == [True, False]
