"""Transmit-receive leakage and bumper reflection: signals in the receivers without a target."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.radar.patterns.cosine import Cosine
from dechirp.simulation.echo_groups import frame_sampling_times
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.bumper import Bumper
from dechirp.simulation.impairments.leakage import Leakage

SPEED_OF_LIGHT_M_PER_S = 299_792_458.0
EMPTY_SCENE = dc.Scene()


@pytest.fixture
def mimo(radar) -> dc.Radar:
    """TDM radar with three transmitters, two receivers and nine chirps."""
    tx_m = [(0, 0.05, 0), (0, 0.058, 0.002), (0.001, 0.066, 0)]
    frame = replace(radar.frame, n_chirps=3, multiplexing=dc.multiplexing.Tdm(order=(2, 0, 1)))
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def simulate_samples(radar, *impairments, scene=EMPTY_SCENE, **options):
    cube = dc.simulate(scene, radar, impairments=impairments, dtype=np.complex128, **options)
    return cube.values[0]


def compute_beat_signal(radar, length_m):
    """Compute the beat signal of a path of constant length, (n_samples,)."""
    chirp, tau = radar.frame.chirp, length_m / SPEED_OF_LIGHT_M_PER_S
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    cycles = chirp.start_frequency_hz * tau + chirp.slope_hz_per_s * (tau * t - tau**2 / 2)
    return np.exp(2j * np.pi * cycles)


def test_leakage_of_each_pair_is_tone_at_antenna_distance(mimo):
    signals = simulate_samples(mimo, Leakage(isolation=1000.0, extra_length_m=0.03))
    amplitude = np.sqrt(mimo.hardware.transmit_power_w / 1000)

    for chirp, row in enumerate(signals):
        transmitter = (2, 0, 1)[chirp % 3]
        for rx_m, signal in zip(mimo.array.rx_m, row, strict=True):
            length_m = np.linalg.norm(np.subtract(rx_m, mimo.array.tx_m[transmitter])) + 0.03
            np.testing.assert_allclose(
                signal, amplitude * compute_beat_signal(mimo, length_m), atol=1e-9 * amplitude
            )


def test_leakage_of_bpm_transmitters_adds_with_their_codes(radar):
    array = replace(radar.array, tx_m=[(0, 0.05, 0), (0, 0.06, 0)])
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Bpm(order=(0, 1)))
    radar = replace(radar, frame=frame, array=array)
    signals = simulate_samples(radar, Leakage(isolation=100.0))
    amplitude = np.sqrt(radar.hardware.transmit_power_w / 100)

    first, second = (amplitude * compute_beat_signal(radar, length_m) for length_m in (0.05, 0.06))
    for chirp, sign in enumerate((1, -1, 1, -1)):
        np.testing.assert_allclose(signals[chirp, 0], first + sign * second, atol=1e-9 * amplitude)


def test_leakage_of_selected_chirps_matches_whole_frame(mimo):
    leakage = Leakage(isolation=100.0)
    expected = simulate_samples(mimo, leakage)
    window = frame_sampling_times(mimo, 0)
    for rows in (slice(0, 1), slice(1, 3), slice(4, 9)):
        signals = np.zeros_like(expected[rows])
        leakage.add_signals(
            signals, window.select_chirps(rows), EMPTY_SCENE, mimo, np.random.default_rng(0)
        )
        np.testing.assert_array_equal(signals, expected[rows])


def test_leakage_adds_to_echoes_and_is_constant_over_frames(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0))])
    impairments = [Leakage(isolation=1e8)]
    cubes = [
        dc.simulate(
            scene, radar, impairments=impairment_set, n_frames=2, dtype=np.complex128
        ).values
        for impairment_set in (impairments, ())
    ]
    leakage_samples = simulate_samples(radar, *impairments)

    for frame in cubes[0] - cubes[1]:
        np.testing.assert_allclose(frame, leakage_samples, atol=1e-9 * abs(leakage_samples).max())


def test_bumper_reflection_follows_friis_over_image_path(mimo):
    signals = simulate_samples(mimo, Bumper(distance_m=0.04, reflectivity=0.05))
    hardware, wavelength_m = mimo.hardware, mimo.frame.chirp.wavelength_m

    for chirp, row in enumerate(signals[:3]):
        tx_m = np.array(mimo.array.tx_m[(2, 0, 1)[chirp]])
        for rx_m, signal in zip(mimo.array.rx_m, row, strict=True):
            separation_m = tx_m - rx_m
            # Path to the bumper and back: the distances of both antennas from it add.
            length_m = np.hypot(np.hypot(*separation_m[1:]), 0.04 - tx_m[0] + 0.04 - rx_m[0])
            power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * 0.05
            power_w *= (wavelength_m / (4 * np.pi * length_m)) ** 2
            expected = -np.sqrt(power_w) * compute_beat_signal(mimo, length_m)
            np.testing.assert_allclose(signal, expected, atol=1e-9 * np.sqrt(power_w))


def test_bumper_echo_has_antenna_gain_at_reflection_angle(radar):
    def power_w(hardware):
        array = dc.Array(tx_m=[(0, 0.06, 0)])
        frame = replace(radar.frame, n_chirps=1)
        tilted_radar = replace(radar, array=array, hardware=hardware, frame=frame)
        return (
            abs(simulate_samples(tilted_radar, Bumper(distance_m=0.04, reflectivity=0.05)))[0, 0, 0]
            ** 2
        )

    pattern = Cosine(azimuth_beamwidth_rad=1.0, elevation_beamwidth_rad=1.0)
    isotropic_power_w = power_w(replace(radar.hardware, antenna_gain=1.0))
    beam_power_w = power_w(
        replace(radar.hardware, antenna_gain=None, tx_pattern=pattern, rx_pattern=pattern)
    )
    # Offset of 6 cm over a path of 8 cm: the ray leaves to the right and arrives from the left.
    angle_rad = np.arctan2(0.06, 0.08)
    expected = pattern.gain_towards(-angle_rad, 0) * pattern.gain_towards(angle_rad, 0)
    assert beam_power_w / isotropic_power_w == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"isolation": 0.001}, "Leakage.isolation.* 30 dB"),
        ({"isolation": 0}, "Leakage.isolation"),
        ({"isolation": 100, "extra_length_m": -1}, "Leakage.extra_length_m"),
    ],
)
def test_rejects_invalid_leakage(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Leakage(**settings)


def test_rejects_bumper_behind_antenna_or_with_reflectivity_above_one(radar):
    forward_radar = replace(radar, array=replace(radar.array, tx_m=[(0.05, 0, 0)]))
    with pytest.raises(dc.InvalidSetting, match="distance: 0.04 m, with an antenna at x = 0.05"):
        simulate_samples(forward_radar, Bumper(distance_m=0.04, reflectivity=0.1))
    with pytest.raises(dc.InvalidSetting, match="Bumper.reflectivity"):
        Bumper(distance_m=0.04, reflectivity=2)


@pytest.mark.parametrize(
    ("text", "impairment"),
    [
        (
            "{kind: leakage, isolation: 30 dB, extra_length: 2 cm}",
            Leakage(isolation=1e3, extra_length_m=0.02),
        ),
        (
            "{kind: bumper, distance: 3 cm, reflectivity: -20 dB}",
            Bumper(distance_m=0.03, reflectivity=0.01),
        ),
    ],
)
def test_settings_round_trip(text, impairment):
    assert parse_settings(text, Impairment) == impairment
    assert parse_settings(dump_yaml(impairment), Impairment) == impairment
