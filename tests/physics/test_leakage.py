"""What goes from transmitters into receivers without a target: leakage and the bumper."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.simulation.echo_groups import sample_window
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.bumper import Bumper
from dechirp.simulation.impairments.leakage import Leakage

LIGHT = 299_792_458.0
EMPTY = dc.Scene()


@pytest.fixture
def mimo(radar) -> dc.Radar:
    """Three transmitters that take turns, two receivers, nine rounds."""
    tx_m = [(0, 0.05, 0), (0, 0.058, 0.002), (0.001, 0.066, 0)]
    frame = replace(radar.frame, n_chirps=3, multiplexing=dc.multiplexing.Tdm(order=(2, 0, 1)))
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def samples(radar, *impairments, scene=EMPTY, **of):
    made = dc.simulate(scene, radar, impairments=impairments, dtype=np.complex128, **of)
    return made.values[0]


def tone(radar, length_m):
    """The beat of a way of constant length, (n_samples,)."""
    chirp, tau = radar.frame.chirp, length_m / LIGHT
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    cycles = chirp.start_frequency_hz * tau + chirp.slope_hz_per_s * (tau * t - tau**2 / 2)
    return np.exp(2j * np.pi * cycles)


def test_leakage_is_a_tone_of_each_pair_at_its_distance(mimo):
    found = samples(mimo, Leakage(isolation=1000.0, extra_length_m=0.03))
    amplitude = np.sqrt(mimo.hardware.transmit_power_w / 1000)

    for chirp, row in enumerate(found):
        transmitter = (2, 0, 1)[chirp % 3]
        for rx_m, signal in zip(mimo.array.rx_m, row, strict=True):
            length_m = np.linalg.norm(np.subtract(rx_m, mimo.array.tx_m[transmitter])) + 0.03
            np.testing.assert_allclose(
                signal, amplitude * tone(mimo, length_m), atol=1e-9 * amplitude
            )


def test_leakage_of_transmitters_that_send_together_adds_with_their_codes(radar):
    array = replace(radar.array, tx_m=[(0, 0.05, 0), (0, 0.06, 0)])
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Bpm(order=(0, 1)))
    radar = replace(radar, frame=frame, array=array)
    found = samples(radar, Leakage(isolation=100.0))
    amplitude = np.sqrt(radar.hardware.transmit_power_w / 100)

    first, second = (amplitude * tone(radar, length_m) for length_m in (0.05, 0.06))
    for chirp, sign in enumerate((1, -1, 1, -1)):
        np.testing.assert_allclose(found[chirp, 0], first + sign * second, atol=1e-9 * amplitude)


def test_leakage_of_some_chirps_is_that_of_all(mimo):
    leakage = Leakage(isolation=100.0)
    whole = samples(mimo, leakage)
    kept = sample_window(mimo, 0)
    for rows in (slice(0, 1), slice(1, 3), slice(4, 9)):
        some = np.zeros_like(whole[rows])
        leakage.add_signals(some, kept.select_chirps(rows), EMPTY, mimo, np.random.default_rng(0))
        np.testing.assert_array_equal(some, whole[rows])


def test_leakage_adds_to_the_echoes_and_stays_the_same_in_all_frames(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0))])
    impairments = [Leakage(isolation=1e8)]
    cubes = [
        dc.simulate(scene, radar, impairments=chosen, n_frames=2, dtype=np.complex128).values
        for chosen in (impairments, ())
    ]
    alone = samples(radar, *impairments)

    for frame in cubes[0] - cubes[1]:
        np.testing.assert_allclose(frame, alone, atol=1e-9 * abs(alone).max())


def test_a_bumper_reflects_by_friis_over_the_way_to_its_image(mimo):
    found = samples(mimo, Bumper(distance_m=0.04, reflectivity=0.05))
    hardware, wavelength_m = mimo.hardware, mimo.frame.chirp.wavelength_m

    for chirp, row in enumerate(found[:3]):
        tx_m = np.array(mimo.array.tx_m[(2, 0, 1)[chirp]])
        for rx_m, signal in zip(mimo.array.rx_m, row, strict=True):
            apart = tx_m - rx_m
            # Down to the plate and up again: heights over it add.
            length_m = np.hypot(np.hypot(*apart[1:]), 0.04 - tx_m[0] + 0.04 - rx_m[0])
            power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * 0.05
            power_w *= (wavelength_m / (4 * np.pi * length_m)) ** 2
            expected = -np.sqrt(power_w) * tone(mimo, length_m)
            np.testing.assert_allclose(signal, expected, atol=1e-9 * np.sqrt(power_w))


def test_antennas_see_the_bumper_at_the_angle_of_the_reflection(radar):
    def power_w(hardware):
        array = dc.Array(tx_m=[(0, 0.06, 0)])
        frame = replace(radar.frame, n_chirps=1)
        seen = replace(radar, array=array, hardware=hardware, frame=frame)
        return abs(samples(seen, Bumper(distance_m=0.04, reflectivity=0.05)))[0, 0, 0] ** 2

    pattern = CosinePattern(azimuth_beamwidth_rad=1.0, elevation_beamwidth_rad=1.0)
    wide = power_w(replace(radar.hardware, antenna_gain=1.0))
    narrow = power_w(
        replace(radar.hardware, antenna_gain=None, tx_pattern=pattern, rx_pattern=pattern)
    )
    # 6 cm aside after 8 cm of way: the transmitter looks right, the receiver left.
    aside = np.arctan2(0.06, 0.08)
    expected = pattern.gain_towards(-aside, 0) * pattern.gain_towards(aside, 0)
    assert narrow / wide == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"isolation": 0.001}, "Leakage.isolation.* 30 dB"),
        ({"isolation": 0}, "Leakage.isolation"),
        ({"isolation": 100, "extra_length_m": -1}, "Leakage.extra_length_m"),
    ],
)
def test_a_leakage_that_cannot_be_is_refused(wrong, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        Leakage(**wrong)


def test_a_bumper_behind_an_antenna_or_brighter_than_a_mirror_is_refused(radar):
    forward = replace(radar, array=replace(radar.array, tx_m=[(0.05, 0, 0)]))
    with pytest.raises(dc.InvalidSetting, match="distance: 0.04 m, with an antenna at x = 0.05"):
        samples(forward, Bumper(distance_m=0.04, reflectivity=0.1))
    with pytest.raises(dc.InvalidSetting, match="Bumper.reflectivity"):
        Bumper(distance_m=0.04, reflectivity=2)


@pytest.mark.parametrize(
    ("text", "made"),
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
def test_settings_files_say_both(text, made):
    assert parse_settings(text, Impairment) == made
    assert parse_settings(dump(made), Impairment) == made
