"""Weather: gas, rain and fog attenuation, rain backscatter and radome loss."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.patterns.cosine import Cosine
from dechirp.simulation.echo_groups import direct_echo_groups, frame_sampling_times
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
from nightly import nightly

HEAVY_RAIN_M_PER_S = 25e-3 / 3600
FAR_SCENE = dc.Scene(targets=[dc.Target(position_m=(70.0, 5.0, 0.0), velocity_m_per_s=(-3, 1, 0))])


def compute_level_db(cube, reference):
    """Compute the power relative to a reference cube, dB."""
    return 10 * np.log10(float(np.mean(abs(cube) ** 2) / np.mean(abs(reference) ** 2)))


@pytest.mark.parametrize(
    ("weather", "db_per_km"),
    [
        (GasAttenuation(), gas_db_per_km(77.3e9)),
        (GasAttenuation(vapour_kg_per_m3=0.02), gas_db_per_km(77.3e9, vapour_kg_per_m3=0.02)),
        (
            RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S),
            rain_db_per_km(77.3e9, HEAVY_RAIN_M_PER_S),
        ),
        (
            RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S, tilt_rad=math.pi / 2),
            rain_db_per_km(77.3e9, HEAVY_RAIN_M_PER_S, tilt_rad=math.pi / 2),
        ),
        (FogAttenuation(water_kg_per_m3=5e-4), fog_db_per_km(77.3e9, 5e-4)),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, float) else "",
)
def test_weather_attenuates_echo_over_two_way_path(radar, weather, db_per_km):
    clear_cube = dc.simulate(FAR_SCENE, radar, impairments=())
    weather_cube = dc.simulate(FAR_SCENE, radar, impairments=[weather])
    # Range at mid-frame, 2.3 ms after the start: 70.17 m; frequency within 1 % of the formula.
    path_km = 2 * 70.17e-3
    assert compute_level_db(weather_cube, clear_cube) == pytest.approx(
        -db_per_km * path_km, abs=2e-3
    )
    # Attenuation is the only change of the echo.
    ratio = (weather_cube / clear_cube).values
    assert abs(ratio - ratio.mean()).max() < 1e-4


def test_heavy_rain_attenuates_echo_at_200_m_by_4_6_db(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=5e12)
    far_radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    scene = dc.Scene(targets=[dc.Target(position_m=(200, 0, 0))])
    clear_cube, rain_cube = (
        dc.simulate(scene, far_radar, impairments=weather)
        for weather in ((), [RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S)])
    )
    assert compute_level_db(rain_cube, clear_cube) == pytest.approx(-4.6, abs=0.05)


def test_each_echo_group_is_attenuated_over_its_own_path(radar):
    # Image antennas, as behind a wall, 30 m further back.
    index, rng = 0, np.random.default_rng(0)
    (group,) = direct_echo_groups(FAR_SCENE, radar, index, rng)
    image_group = group._replace(
        transmission=group.transmission._replace(tx_m=group.transmission.tx_m - [30.0, 0, 0])
    )
    attenuated_group, attenuated_image = RainAttenuation(
        rate_m_per_s=HEAVY_RAIN_M_PER_S
    ).transform_echoes(
        [group, image_group], frame_sampling_times(radar, index), FAR_SCENE, radar, rng
    )
    factor = attenuated_image.scatterers.amplitudes[0] / attenuated_group.scatterers.amplitudes[0]
    target_m = group.scatterers.path_m[0][0]
    extra_km = (np.linalg.norm(target_m + np.array([30, 0, 0])) - np.linalg.norm(target_m)) / 1000
    frequency_hz = radar.frame.chirp.mid_window_frequency_hz
    expected_db = -rain_db_per_km(frequency_hz, HEAVY_RAIN_M_PER_S) * extra_km
    assert 20 * np.log10(factor) == pytest.approx(expected_db, rel=1e-9)


def test_weather_attenuations_add_in_decibels(radar):
    weathers = [
        GasAttenuation(),
        RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S),
        FogAttenuation(water_kg_per_m3=5e-4),
    ]
    clear_cube = dc.simulate(FAR_SCENE, radar, impairments=())
    single_db = [
        compute_level_db(dc.simulate(FAR_SCENE, radar, impairments=[weather]), clear_cube)
        for weather in weathers
    ]
    total_db = compute_level_db(dc.simulate(FAR_SCENE, radar, impairments=weathers), clear_cube)
    assert total_db == pytest.approx(sum(single_db), abs=1e-5)


# Two chirps per frame suffice: powers are averaged over frames.
def shorten_frame(radar, **hardware):
    return replace(
        radar,
        frame=replace(radar.frame, n_chirps=2),
        hardware=replace(radar.hardware, **hardware),
    )


def measure_clutter_w(cube, radar, low_m, high_m):
    """Measure the mean echo power between two ranges, (n_frames,)."""
    n = cube.sizes["sample"]
    taper = np.blackman(n)
    power = abs(np.fft.fft(cube.values * taper, axis=-1)) ** 2 / (n * (taper**2).sum())
    bins_m = radar.frame.chirp.range_bins_m()
    is_selected = (bins_m >= low_m) & (bins_m < high_m)
    return power[..., is_selected].sum(axis=-1).mean(axis=(1, 2))


def integrate_solid_angle_sr(hardware):
    """Integrate the product of both gains over cells of a quarter of a degree."""
    azimuth = np.radians(np.arange(-180, 180, 0.25) + 0.125)
    elevation = np.radians(np.arange(-90, 90, 0.25) + 0.125)
    gain_product = hardware.tx_gain(azimuth[:, None], elevation) * hardware.rx_gain(
        azimuth[:, None], elevation
    )
    return float((gain_product * np.cos(elevation)).sum() * np.radians(0.25) ** 2)


BEAM = Cosine(azimuth_beamwidth_rad=0.9, elevation_beamwidth_rad=0.2)
NARROW_BEAM = Cosine(azimuth_beamwidth_rad=0.15, elevation_beamwidth_rad=0.1)


@nightly
@pytest.mark.parametrize(
    "hardware",
    [
        {},
        {"tx_pattern": BEAM, "rx_pattern": BEAM},
        {"tx_pattern": BEAM, "rx_pattern": NARROW_BEAM},
    ],
    ids=["constant gain", "one beam", "two beams"],
)
def test_rain_backscatter_follows_volume_radar_equation(radar, hardware):
    radar = shorten_frame(radar, **hardware)
    rain = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S)
    n_frames = 150
    cube = dc.simulate(dc.Scene(), radar, impairments=[rain], n_frames=n_frames, seed=11)

    # A constant gain of 10 covers 4 pi / 10 sr.
    angle_sr = integrate_solid_angle_sr(radar.hardware) if hardware else 10.0**2 * 4 * math.pi / 10
    chirp = radar.frame.chirp
    eta = rain_reflectivity_per_m(chirp.mid_window_frequency_hz, HEAVY_RAIN_M_PER_S)
    factor = radar.hardware.transmit_power_w * chirp.wavelength_m**2 * eta / (4 * math.pi) ** 3
    width_m = chirp.range_resolution_m
    for low_m, high_m in [(8, 16), (16, 32), (32, 64)]:
        # Bins extend half a width to each side.
        low_bin, high_bin = (math.ceil(limit_m / width_m) - 0.5 for limit_m in (low_m, high_m))
        expected_w = factor * angle_sr * (1 / low_bin - 1 / high_bin) / width_m
        clutter_w = measure_clutter_w(cube, radar, low_m, high_m)
        error_w = clutter_w.std(ddof=1) / math.sqrt(n_frames)
        assert error_w < 0.03 * expected_w
        assert abs(clutter_w.mean() - expected_w) < 4 * error_w + 0.005 * expected_w


@nightly
def test_rain_is_speckle_with_exponential_powers(radar):
    cube = dc.simulate(
        dc.Scene(),
        shorten_frame(radar),
        impairments=[RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S)],
        n_frames=150,
    )
    taper = np.hanning(256)
    power = abs(np.fft.fft(cube.values[:, 0, 0] * taper, axis=-1))[:, 40:200:4] ** 2
    power = power / power.mean(axis=0)
    # Exponential distribution: variance equals squared mean. 6,000 powers with a fourth moment of
    # 24: a standard error of 0.04.
    assert power.var() == pytest.approx(1.0, abs=0.2)


def test_rain_approaches_upward_looking_radar(radar):
    # Drops in a narrow beam have their reflectivity-weighted mean speed; horizontal wind is
    # perpendicular to the beam.
    hardware = replace(radar.hardware, tx_pattern=NARROW_BEAM, rx_pattern=NARROW_BEAM)
    radar = replace(radar, hardware=hardware, frame=replace(radar.frame, n_chirps=16))
    scene = dc.Scene(ego=dc.Ego(pitch_rad=math.pi / 2, velocity_m_per_s=(0, 0, -2)))
    cube = dc.simulate(
        scene,
        radar,
        impairments=[RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S)],
        n_frames=40,
        seed=5,
    ).values
    turn_rad = np.angle((cube[:, 1:] * cube[:, :-1].conj()).sum())
    velocity = turn_rad * radar.frame.chirp.wavelength_m / (4 * math.pi * 35e-6)

    shares = rain_reflectivity_per_m4(radar.frame.chirp.mid_window_frequency_hz, HEAVY_RAIN_M_PER_S)
    fall = float((shares * drop_fall_speed_m_per_s(DIAMETERS_M)).sum() / shares.sum())
    assert 4 < fall < 8
    # The radar sinks at 2 m/s, away from drops that fall faster. The beamwidth reduces velocities
    # by 1 %; a spread of 1.3 m/s among hundreds of scatterers gives an error of 0.1 m/s.
    assert velocity == pytest.approx(-(fall - 2), abs=0.2)


def test_wind_moves_rain(radar):
    hardware = replace(radar.hardware, tx_pattern=NARROW_BEAM, rx_pattern=NARROW_BEAM)
    radar = replace(radar, hardware=hardware, frame=replace(radar.frame, n_chirps=16))
    rain = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, wind_m_per_s=(6.0, 0.0, 0.0))
    cube = dc.simulate(dc.Scene(), radar, impairments=[rain], n_frames=10, seed=5).values
    turn_rad = np.angle((cube[:, 1:] * cube[:, :-1].conj()).sum())
    velocity = turn_rad * radar.frame.chirp.wavelength_m / (4 * math.pi * 35e-6)
    assert velocity == pytest.approx(6.0, abs=0.2)


def test_drop_paths_follow_turning_radar(radar):
    # Reference: the path of a target with the position and velocity of the drop.
    ego = dc.Ego(
        position_m=(3, 1, 0),
        yaw_rad=0.4,
        pitch_rad=0.1,
        velocity_m_per_s=(12, -1, 0),
        turn_rate_rad_per_s=0.6,
    )
    rain = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, n_scatterers=20, wind_m_per_s=(3, 2, 0))
    rng = np.random.default_rng(3)
    (group,) = rain.transform_echoes(
        [], frame_sampling_times(radar, 2), dc.Scene(ego=ego), radar, rng
    )
    mid_s = radar.frame.frame_start_s(2) + radar.frame.mid_frame_s
    axes, radar_m = ego.axes(np.array([mid_s]))[0], ego.displacements_m(np.array([mid_s]))[0]
    path_m = group.scatterers.path_m
    turn_rate = np.array([0, 0, 0.6])
    for i in range(20):
        offset_m = axes @ path_m[0, i]
        velocity = axes @ path_m[1, i] + np.cross(turn_rate, offset_m)
        velocity = velocity + ego.velocities_m_per_s(np.array([mid_s]))[0]
        start_m = np.array(ego.position_m) + radar_m + offset_m - velocity * mid_s
        drop = dc.Target(position_m=tuple(start_m), velocity_m_per_s=tuple(velocity))
        # Drops move with the wind, and fall.
        assert velocity[:2] == pytest.approx([3, 2])
        assert -9 < velocity[2] <= 0
        for t in (-2e-3, 2e-3):
            exact_m = dc.Scene(targets=[drop], ego=ego).scatterer_positions_m([mid_s + t])[0, 0]
            position_m = path_m[0, i] + path_m[1, i] * t + path_m[2, i] * t**2
            # Third-order residual: 75 m (0.6 rad/s 2 ms)^3 / 6.
            assert position_m == pytest.approx(exact_m, abs=1e-7)


def test_rain_backscatter_does_not_change_target_echoes(radar):
    rain = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, n_scatterers=200)
    rain_cube = dc.simulate(dc.Scene(), radar, impairments=[rain], seed=4)
    clear_cube = dc.simulate(FAR_SCENE, radar, impairments=())
    full_cube = dc.simulate(FAR_SCENE, radar, impairments=[rain], seed=4)
    assert abs(full_cube - rain_cube - clear_cube).max() < 1e-4 * abs(clear_cube).max()
    dry_cube = dc.simulate(FAR_SCENE, radar, impairments=[RainBackscatter(rate_m_per_s=0.0)])
    assert (dry_cube == clear_cube).all()


def test_later_rain_attenuation_applies_to_rain_backscatter(radar):
    # Two-way attenuation to 70 m: 1.6 dB; to 10 m: 0.2 dB.
    short_radar = shorten_frame(radar)
    drops = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, min_range_m=60.0, max_range_m=70.0)
    drops_cube = dc.simulate(dc.Scene(), short_radar, impairments=[drops], seed=4)
    attenuated_cube = dc.simulate(
        dc.Scene(),
        short_radar,
        impairments=[drops, RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S)],
        seed=4,
    )
    assert compute_level_db(attenuated_cube, drops_cube) == pytest.approx(-11.4 * 0.13, abs=0.1)


def test_wet_radome_attenuates_echoes_twice(radar):
    clear_cube = dc.simulate(FAR_SCENE, radar, impairments=())
    radome_cube = dc.simulate(FAR_SCENE, radar, impairments=[Radome(film_m=0.1e-3)])
    film_db = 10 * math.log10(
        water_film_loss(radar.frame.chirp.mid_window_frequency_hz, 0.1e-3, 283.15)
    )
    assert film_db == pytest.approx(6.3, abs=0.1)
    assert compute_level_db(radome_cube, clear_cube) == pytest.approx(-2 * film_db, abs=1e-3)


def test_dry_radome_attenuates_by_its_loss_only(radar):
    clear_cube = dc.simulate(FAR_SCENE, radar, impairments=())
    assert (dc.simulate(FAR_SCENE, radar, impairments=[Radome()]) == clear_cube).all()
    lossy_cube = dc.simulate(FAR_SCENE, radar, impairments=[Radome(loss=2.0)])
    assert compute_level_db(lossy_cube, clear_cube) == pytest.approx(-3.0103, abs=1e-3)


def test_radome_attenuates_rain_regardless_of_order(radar):
    drops, radome = RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S), Radome(loss=4.0)
    drops_cube = dc.simulate(dc.Scene(), shorten_frame(radar), impairments=[drops], seed=4)
    radome_last_cube = dc.simulate(
        dc.Scene(), shorten_frame(radar), impairments=[drops, radome], seed=4
    )
    assert compute_level_db(radome_last_cube, drops_cube) == pytest.approx(-6.0206, abs=1e-3)
    radome_first_cube = dc.simulate(
        dc.Scene(), shorten_frame(radar), impairments=[radome, drops], seed=4
    )
    np.testing.assert_allclose(
        radome_first_cube, radome_last_cube, rtol=0, atol=1e-6 * float(abs(radome_last_cube).max())
    )


@pytest.mark.parametrize(
    ("build_impairment", "setting"),
    [
        (lambda: GasAttenuation(pressure_pa=-1.0), "GasAttenuation.pressure_pa"),
        (lambda: GasAttenuation(temperature_k=15.0), "GasAttenuation.temperature_k"),
        (lambda: GasAttenuation(vapour_kg_per_m3=7.5), "GasAttenuation.vapour_kg_per_m3"),
        (lambda: RainAttenuation(rate_m_per_s=-1e-6), "RainAttenuation.rate_m_per_s"),
        (lambda: RainAttenuation(rate_m_per_s=25.0), "RainAttenuation.rate_m_per_s: 9e.07 mm/h"),
        (lambda: RainAttenuation(rate_m_per_s=math.nan), "RainAttenuation.rate_m_per_s"),
        (
            lambda: RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S, tilt_rad=45.0),
            "RainAttenuation.tilt_rad",
        ),
        (lambda: FogAttenuation(water_kg_per_m3=0.5), "FogAttenuation.water_kg_per_m3"),
        (
            lambda: FogAttenuation(water_kg_per_m3=5e-4, temperature_k=10.0),
            "FogAttenuation.temperature_k",
        ),
        (lambda: RainBackscatter(rate_m_per_s=-1e-6), "RainBackscatter.rate_m_per_s"),
        (lambda: RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, n_scatterers=0), "n_scatterers"),
        (lambda: RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, min_range_m=0.0), "min_range_m"),
        (
            lambda: RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, wind_m_per_s=(1e6, 0, 0)),
            "wind_m_per_s",
        ),
        (lambda: Radome(film_m=-1e-4), "Radome.film_m"),
        (lambda: Radome(film_m=0.1), "Radome.film_m"),
        (lambda: Radome(loss=0.5), "Radome.loss"),
    ],
)
def test_rejects_invalid_weather(build_impairment, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        build_impairment()


@pytest.mark.parametrize(
    ("weather", "frequency_hz"),
    [
        (GasAttenuation(), 0.5e9),
        (RainAttenuation(rate_m_per_s=HEAVY_RAIN_M_PER_S), 0.5e9),
        (FogAttenuation(water_kg_per_m3=5e-4), 300e9),
        (RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S), 2e12),
        (Radome(film_m=1e-4), 2e12),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, float) else "",
)
def test_rejects_frequency_outside_formula(radar, weather, frequency_hz):
    chirp = replace(radar.frame.chirp, start_frequency_hz=frequency_hz)
    radar_out_of_band = replace(radar, frame=replace(radar.frame, chirp=chirp))
    with pytest.raises(dc.InvalidSetting, match=r"kind: .*, with a radar at .* GHz"):
        weather.check(FAR_SCENE, radar_out_of_band)


def test_rejects_rain_without_ranges_or_directions(radar):
    with pytest.raises(dc.InvalidSetting, match="max_range: 75 m; expected beyond min_range"):
        RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S, min_range_m=75.0, max_range_m=75.0).check(
            FAR_SCENE, radar
        )
    backward_beam = replace(BEAM, beam_azimuth_rad=math.pi)
    blind_radar = replace(
        radar, hardware=replace(radar.hardware, tx_pattern=BEAM, rx_pattern=backward_beam)
    )
    with pytest.raises(dc.InvalidSetting, match="antennas whose beams do not overlap"):
        RainBackscatter(rate_m_per_s=HEAVY_RAIN_M_PER_S).check(FAR_SCENE, blind_radar)


def test_zero_dimensional_arrays_become_floats():
    rate, power = np.array(7e-6), np.array(1e-3)
    assert hash(RainAttenuation(rate_m_per_s=rate)) == hash(RainAttenuation(rate_m_per_s=7e-6))
    assert type(RainAttenuation(rate_m_per_s=rate).rate_m_per_s) is float
    assert hash(dc.impairments.Compression(p1db_w=power)) == hash(
        dc.impairments.Compression(p1db_w=1e-3)
    )
