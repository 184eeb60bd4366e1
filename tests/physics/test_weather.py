"""Gas, rain and fog weaken echoes, rain sends some back, and a wet radome takes its share."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.simulation.echo_groups import direct_echo_groups, sample_window
from dechirp.simulation.impairments.fog_attenuation import FogAttenuation
from dechirp.simulation.impairments.gas_attenuation import GasAttenuation
from dechirp.simulation.impairments.radome import Radome
from dechirp.simulation.impairments.rain_attenuation import RainAttenuation
from dechirp.simulation.impairments.rain_backscatter import RainBackscatter
from dechirp.theory.attenuation import fog_db_per_km, gas_db_per_km, rain_db_per_km
from dechirp.theory.rain_backscatter import (
    DIAMETERS_M,
    drop_fall_speed_m_per_s,
    rain_reflectivity_per_m,
    rain_reflectivity_per_m4,
)
from dechirp.theory.water_permittivity import water_film_loss

HEAVY = 25e-3 / 3600
FAR = dc.Scene(targets=[dc.Target(position_m=(70.0, 5.0, 0.0), velocity_m_per_s=(-3, 1, 0))])


def level_db(cube, other):
    """Power over that of another cube, dB."""
    return 10 * np.log10(float(np.mean(abs(cube) ** 2) / np.mean(abs(other) ** 2)))


@pytest.mark.parametrize(
    ("air", "db_per_km"),
    [
        (GasAttenuation(), gas_db_per_km(77.3e9)),
        (GasAttenuation(vapour_kg_per_m3=0.02), gas_db_per_km(77.3e9, vapour_kg_per_m3=0.02)),
        (RainAttenuation(rate_m_per_s=HEAVY), rain_db_per_km(77.3e9, HEAVY)),
        (
            RainAttenuation(rate_m_per_s=HEAVY, tilt_rad=math.pi / 2),
            rain_db_per_km(77.3e9, HEAVY, tilt_rad=math.pi / 2),
        ),
        (FogAttenuation(water_kg_per_m3=5e-4), fog_db_per_km(77.3e9, 5e-4)),
    ],
    ids=lambda one: type(one).__name__ if not isinstance(one, float) else "",
)
def test_an_echo_is_weakened_over_both_ways(radar, air, db_per_km):
    clear = dc.simulate(FAR, radar, impairments=())
    found = dc.simulate(FAR, radar, impairments=[air])
    # At mid-frame, 2.3 ms after the start: 70.17 m, and 1 % of the frequency of the formula.
    ways_km = 2 * 70.17e-3
    assert level_db(found, clear) == pytest.approx(-db_per_km * ways_km, abs=2e-3)
    # Nothing else happens to it.
    ratio = (found / clear).values
    assert abs(ratio - ratio.mean()).max() < 1e-4


def test_rain_takes_4_6_db_from_an_echo_at_200_m(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=5e12)
    far = replace(radar, frame=replace(radar.frame, chirp=chirp))
    scene = dc.Scene(targets=[dc.Target(position_m=(200, 0, 0))])
    clear, wet = (
        dc.simulate(scene, far, impairments=weather)
        for weather in ((), [RainAttenuation(rate_m_per_s=HEAVY)])
    )
    assert level_db(wet, clear) == pytest.approx(-4.6, abs=0.05)


def test_each_part_is_weakened_over_its_own_ways(radar):
    # As images of the antennas in a wall are: these are 30 m further back.
    index, rng = 0, np.random.default_rng(0)
    (part,) = direct_echo_groups(FAR, radar, index, rng)
    image = part._replace(
        transmission=part.transmission._replace(tx_m=part.transmission.tx_m - [30.0, 0, 0])
    )
    here, there = RainAttenuation(rate_m_per_s=HEAVY).transform_echoes(
        [part, image], sample_window(radar, index), FAR, radar, rng
    )
    factor = there.scatterers.amplitudes[0] / here.scatterers.amplitudes[0]
    at_m = part.scatterers.path_m[0][0]
    more_km = (np.linalg.norm(at_m + np.array([30, 0, 0])) - np.linalg.norm(at_m)) / 1000
    frequency_hz = radar.frame.chirp.mid_window_frequency_hz
    expected_db = -rain_db_per_km(frequency_hz, HEAVY) * more_km
    assert 20 * np.log10(factor) == pytest.approx(expected_db, rel=1e-9)


def test_weather_adds_up_in_decibels(radar):
    together = [
        GasAttenuation(),
        RainAttenuation(rate_m_per_s=HEAVY),
        FogAttenuation(water_kg_per_m3=5e-4),
    ]
    clear = dc.simulate(FAR, radar, impairments=())
    alone_db = [level_db(dc.simulate(FAR, radar, impairments=[one]), clear) for one in together]
    found_db = level_db(dc.simulate(FAR, radar, impairments=together), clear)
    assert found_db == pytest.approx(sum(alone_db), abs=1e-5)


# Two chirps a frame: frames are what is averaged.
def short(radar, **hardware):
    return replace(
        radar,
        frame=replace(radar.frame, n_chirps=2),
        hardware=replace(radar.hardware, **hardware),
    )


def clutter_w(cube, radar, low_m, high_m):
    """Mean echo power between two ranges, in each frame, (n_frames,)."""
    n = cube.sizes["sample"]
    taper = np.blackman(n)
    power = abs(np.fft.fft(cube.values * taper, axis=-1)) ** 2 / (n * (taper**2).sum())
    bins_m = radar.frame.chirp.range_bins_m()
    ring = (bins_m >= low_m) & (bins_m < high_m)
    return power[..., ring].sum(axis=-1).mean(axis=(1, 2))


def solid_angle_sr(hardware):
    """Integral of the product of both gains, on cells of a quarter of a degree."""
    side = np.radians(np.arange(-180, 180, 0.25) + 0.125)
    up = np.radians(np.arange(-90, 90, 0.25) + 0.125)
    both = hardware.tx_gain(side[:, None], up) * hardware.rx_gain(side[:, None], up)
    return float((both * np.cos(up)).sum() * np.radians(0.25) ** 2)


BEAM = CosinePattern(azimuth_beamwidth_rad=0.9, elevation_beamwidth_rad=0.2)
NARROW = CosinePattern(azimuth_beamwidth_rad=0.15, elevation_beamwidth_rad=0.1)


@pytest.mark.parametrize(
    "hardware",
    [{}, {"tx_pattern": BEAM, "rx_pattern": BEAM}, {"tx_pattern": BEAM, "rx_pattern": NARROW}],
    ids=["gain alone", "one beam", "two beams"],
)
def test_rain_sends_back_what_the_radar_equation_for_a_volume_says(radar, hardware):
    radar = short(radar, **hardware)
    rain = RainBackscatter(rate_m_per_s=HEAVY)
    n_frames = 150
    cube = dc.simulate(dc.Scene(), radar, impairments=[rain], n_frames=n_frames, seed=11)

    # Without a pattern, a gain of 10 in 4 pi / 10 sr.
    angle_sr = solid_angle_sr(radar.hardware) if hardware else 10.0**2 * 4 * math.pi / 10
    chirp = radar.frame.chirp
    eta = rain_reflectivity_per_m(chirp.mid_window_frequency_hz, HEAVY)
    factor = radar.hardware.transmit_power_w * chirp.wavelength_m**2 * eta / (4 * math.pi) ** 3
    width_m = chirp.range_resolution_m
    for low_m, high_m in [(8, 16), (16, 32), (32, 64)]:
        # Bins reach half a width to each side.
        low_bin, high_bin = (math.ceil(at_m / width_m) - 0.5 for at_m in (low_m, high_m))
        expected_w = factor * angle_sr * (1 / low_bin - 1 / high_bin) / width_m
        found_w = clutter_w(cube, radar, low_m, high_m)
        error_w = found_w.std(ddof=1) / math.sqrt(n_frames)
        assert error_w < 0.03 * expected_w
        assert abs(found_w.mean() - expected_w) < 4 * error_w + 0.005 * expected_w


def test_rain_is_speckle_with_exponential_powers(radar):
    cube = dc.simulate(
        dc.Scene(), short(radar), impairments=[RainBackscatter(rate_m_per_s=HEAVY)], n_frames=300
    )
    taper = np.hanning(256)
    power = abs(np.fft.fft(cube.values[:, 0, 0] * taper, axis=-1))[:, 40:200:4] ** 2
    power = power / power.mean(axis=0)
    # Exponential: the variance is the square of the mean. 12,000 looks, the fourth moment is 24:
    # a standard error of 0.03.
    assert power.var() == pytest.approx(1.0, abs=0.12)


def test_rain_falls_towards_a_radar_that_looks_up(radar):
    # Through a narrow beam, drops at the mean speed of what they send back; a wind along the
    # ground is across.
    hardware = replace(radar.hardware, tx_pattern=NARROW, rx_pattern=NARROW)
    radar = replace(radar, hardware=hardware, frame=replace(radar.frame, n_chirps=16))
    scene = dc.Scene(ego=dc.Ego(pitch_rad=math.pi / 2, velocity_m_per_s=(0, 0, -2)))
    cube = dc.simulate(
        scene, radar, impairments=[RainBackscatter(rate_m_per_s=HEAVY)], n_frames=40, seed=5
    ).values
    turn_rad = np.angle((cube[:, 1:] * cube[:, :-1].conj()).sum())
    velocity = turn_rad * radar.frame.chirp.wavelength_m / (4 * math.pi * 35e-6)

    shares = rain_reflectivity_per_m4(radar.frame.chirp.mid_window_frequency_hz, HEAVY)
    fall = float((shares * drop_fall_speed_m_per_s(DIAMETERS_M)).sum() / shares.sum())
    assert 4 < fall < 8
    # The radar sinks at 2 m/s, away from drops that fall faster. The beam's width takes a
    # hundredth; a spread of 1.3 m/s among hundreds of scatterers leaves 0.1 m/s.
    assert velocity == pytest.approx(-(fall - 2), abs=0.2)


def test_the_wind_moves_the_rain(radar):
    narrow = replace(radar.hardware, tx_pattern=NARROW, rx_pattern=NARROW)
    radar = replace(radar, hardware=narrow, frame=replace(radar.frame, n_chirps=16))
    rain = RainBackscatter(rate_m_per_s=HEAVY, wind_m_per_s=(6.0, 0.0, 0.0))
    cube = dc.simulate(dc.Scene(), radar, impairments=[rain], n_frames=10, seed=5).values
    turn_rad = np.angle((cube[:, 1:] * cube[:, :-1].conj()).sum())
    velocity = turn_rad * radar.frame.chirp.wavelength_m / (4 * math.pi * 35e-6)
    assert velocity == pytest.approx(6.0, abs=0.2)


def test_drops_keep_their_places_while_the_radar_turns(radar):
    # A drop's path against that of a target with its place and velocity, over the frame.
    ego = dc.Ego(
        position_m=(3, 1, 0),
        yaw_rad=0.4,
        pitch_rad=0.1,
        velocity_m_per_s=(12, -1, 0),
        turn_rate_rad_per_s=0.6,
    )
    rain = RainBackscatter(rate_m_per_s=HEAVY, n_scatterers=20, wind_m_per_s=(3, 2, 0))
    rng = np.random.default_rng(3)
    (part,) = rain.transform_echoes([], sample_window(radar, 2), dc.Scene(ego=ego), radar, rng)
    mid_s = radar.frame.frame_start_s(2) + radar.frame.mid_frame_s
    axes, own_m = ego.axes(np.array([mid_s]))[0], ego.displacements_m(np.array([mid_s]))[0]
    path_m = part.scatterers.path_m
    turn = np.array([0, 0, 0.6])
    for i in range(20):
        from_radar_m = axes @ path_m[0, i]
        moving = axes @ path_m[1, i] + np.cross(turn, from_radar_m)
        moving = moving + ego.velocities_m_per_s(np.array([mid_s]))[0]
        start_m = np.array(ego.position_m) + own_m + from_radar_m - moving * mid_s
        drop = dc.Target(position_m=tuple(start_m), velocity_m_per_s=tuple(moving))
        # They go with the wind, and fall.
        assert moving[:2] == pytest.approx([3, 2])
        assert -9 < moving[2] <= 0
        for t in (-2e-3, 2e-3):
            exact_m = dc.Scene(targets=[drop], ego=ego).positions_m([mid_s + t])[0, 0]
            found_m = path_m[0, i] + path_m[1, i] * t + path_m[2, i] * t**2
            # What is left, the third order: 75 m (0.6 rad/s 2 ms)^3 / 6.
            assert found_m == pytest.approx(exact_m, abs=1e-7)


def test_rain_backscatter_leaves_the_targets_as_they_are(radar):
    rain = RainBackscatter(rate_m_per_s=HEAVY, n_scatterers=200)
    alone = dc.simulate(dc.Scene(), radar, impairments=[rain], seed=4)
    clear = dc.simulate(FAR, radar, impairments=())
    both = dc.simulate(FAR, radar, impairments=[rain], seed=4)
    assert abs(both - alone - clear).max() < 1e-4 * abs(clear).max()
    none = dc.simulate(FAR, radar, impairments=[RainBackscatter(rate_m_per_s=0.0)])
    assert (none == clear).all()


def test_rain_weakens_its_own_echoes_where_it_comes_later(radar):
    # Both ways to 70 m take 1.6 dB, to 10 m 0.2 dB.
    short_radar = short(radar)
    drops = RainBackscatter(rate_m_per_s=HEAVY, min_range_m=60.0, max_range_m=70.0)
    alone = dc.simulate(dc.Scene(), short_radar, impairments=[drops], seed=4)
    after = dc.simulate(
        dc.Scene(), short_radar, impairments=[drops, RainAttenuation(rate_m_per_s=HEAVY)], seed=4
    )
    assert level_db(after, alone) == pytest.approx(-11.4 * 0.13, abs=0.1)


def test_a_wet_radome_weakens_echoes_twice(radar):
    clear = dc.simulate(FAR, radar, impairments=())
    wet = dc.simulate(FAR, radar, impairments=[Radome(film_m=0.1e-3)])
    film_db = 10 * math.log10(
        water_film_loss(radar.frame.chirp.mid_window_frequency_hz, 0.1e-3, 283.15)
    )
    assert film_db == pytest.approx(6.3, abs=0.1)
    assert level_db(wet, clear) == pytest.approx(-2 * film_db, abs=1e-3)


def test_a_dry_radome_takes_its_loss_and_a_clear_one_none(radar):
    clear = dc.simulate(FAR, radar, impairments=())
    assert (dc.simulate(FAR, radar, impairments=[Radome()]) == clear).all()
    dry = dc.simulate(FAR, radar, impairments=[Radome(loss=2.0)])
    assert level_db(dry, clear) == pytest.approx(-3.0103, abs=1e-3)


def test_a_radome_weakens_rain_beyond_it_wherever_it_is_listed(radar):
    drops, radome = RainBackscatter(rate_m_per_s=HEAVY), Radome(loss=4.0)
    alone = dc.simulate(dc.Scene(), short(radar), impairments=[drops], seed=4)
    behind = dc.simulate(dc.Scene(), short(radar), impairments=[drops, radome], seed=4)
    assert level_db(behind, alone) == pytest.approx(-6.0206, abs=1e-3)
    before = dc.simulate(dc.Scene(), short(radar), impairments=[radome, drops], seed=4)
    np.testing.assert_allclose(before, behind, rtol=0, atol=1e-6 * float(abs(behind).max()))


@pytest.mark.parametrize(
    ("make", "setting"),
    [
        (lambda: GasAttenuation(pressure_pa=-1.0), "GasAttenuation.pressure_pa"),
        (lambda: GasAttenuation(temperature_k=15.0), "GasAttenuation.temperature_k"),
        (lambda: GasAttenuation(vapour_kg_per_m3=7.5), "GasAttenuation.vapour_kg_per_m3"),
        (lambda: RainAttenuation(rate_m_per_s=-1e-6), "RainAttenuation.rate_m_per_s"),
        (lambda: RainAttenuation(rate_m_per_s=25.0), "RainAttenuation.rate_m_per_s: 9e.07 mm/h"),
        (lambda: RainAttenuation(rate_m_per_s=math.nan), "RainAttenuation.rate_m_per_s"),
        (lambda: RainAttenuation(rate_m_per_s=HEAVY, tilt_rad=45.0), "RainAttenuation.tilt_rad"),
        (lambda: FogAttenuation(water_kg_per_m3=0.5), "FogAttenuation.water_kg_per_m3"),
        (
            lambda: FogAttenuation(water_kg_per_m3=5e-4, temperature_k=10.0),
            "FogAttenuation.temperature_k",
        ),
        (lambda: RainBackscatter(rate_m_per_s=-1e-6), "RainBackscatter.rate_m_per_s"),
        (lambda: RainBackscatter(rate_m_per_s=HEAVY, n_scatterers=0), "n_scatterers"),
        (lambda: RainBackscatter(rate_m_per_s=HEAVY, min_range_m=0.0), "min_range_m"),
        (lambda: RainBackscatter(rate_m_per_s=HEAVY, wind_m_per_s=(1e6, 0, 0)), "wind_m_per_s"),
        (lambda: Radome(film_m=-1e-4), "Radome.film_m"),
        (lambda: Radome(film_m=0.1), "Radome.film_m"),
        (lambda: Radome(loss=0.5), "Radome.loss"),
    ],
)
def test_weather_that_cannot_be_is_refused(make, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        make()


@pytest.mark.parametrize(
    ("air", "frequency_hz"),
    [
        (GasAttenuation(), 0.5e9),
        (RainAttenuation(rate_m_per_s=HEAVY), 0.5e9),
        (FogAttenuation(water_kg_per_m3=5e-4), 300e9),
        (RainBackscatter(rate_m_per_s=HEAVY), 2e12),
        (Radome(film_m=1e-4), 2e12),
    ],
    ids=lambda one: type(one).__name__ if not isinstance(one, float) else "",
)
def test_a_formula_says_at_which_frequencies_it_does_not_hold(radar, air, frequency_hz):
    chirp = replace(radar.frame.chirp, start_frequency_hz=frequency_hz)
    elsewhere = replace(radar, frame=replace(radar.frame, chirp=chirp))
    with pytest.raises(dc.InvalidSetting, match=r"kind: .*, with a radar at .* GHz"):
        air.check(FAR, elsewhere)


def test_rain_in_no_ranges_or_directions_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match="max_range: 75 m; expected beyond min_range"):
        RainBackscatter(rate_m_per_s=HEAVY, min_range_m=75.0, max_range_m=75.0).check(FAR, radar)
    back = replace(BEAM, beam_azimuth_rad=math.pi)
    blind = replace(radar, hardware=replace(radar.hardware, tx_pattern=BEAM, rx_pattern=back))
    with pytest.raises(dc.InvalidSetting, match="antennas whose beams do not overlap"):
        RainBackscatter(rate_m_per_s=HEAVY).check(FAR, blind)


def test_settings_that_functions_of_one_ratio_return_are_kept_as_numbers():
    rate, power = np.array(7e-6), np.array(1e-3)
    assert hash(RainAttenuation(rate_m_per_s=rate)) == hash(RainAttenuation(rate_m_per_s=7e-6))
    assert type(RainAttenuation(rate_m_per_s=rate).rate_m_per_s) is float
    assert hash(dc.impairments.Compression(p1db_w=power)) == hash(
        dc.impairments.Compression(p1db_w=1e-3)
    )
