"""IF filters before the converter: response at the analog beat frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, freqs

import dechirp as dc
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.noise import ThermalNoise

RATE_HZ = 10e6


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def filter_tones(radar, impairment, beats_hz):
    """Filter tones of power 1, one per chirp, without margins: (n_tones, n_samples)."""
    n_before, n_after = impairment.sample_margins(radar)
    times_s = (np.arange(256 + n_before + n_after) - n_before) / RATE_HZ
    waves = np.exp(2j * np.pi * np.asarray(beats_hz)[:, None] * times_s)
    if radar.frame.chirp.sampling == "real":
        waves = np.sqrt(2) * waves.real
    samples = np.ascontiguousarray(waves[None, :, None, :])
    impairment.apply_to_samples(samples, dc.Scene(), radar, np.random.default_rng(0))
    return samples[0, :, 0, n_before : n_before + 256]


def build_expected_tones(radar, gains, beats_hz):
    times_s = np.arange(256) / RATE_HZ
    waves = gains[:, None] * np.exp(2j * np.pi * np.asarray(beats_hz)[:, None] * times_s)
    return waves if radar.frame.chirp.sampling == "complex" else np.sqrt(2) * waves.real


def compute_analog_gains(high, low, beats_hz):
    """Compute complex gains of SciPy's analog Butterworth filters."""
    angular_frequencies = 2 * np.pi * np.asarray(beats_hz)
    gains = np.ones(len(angular_frequencies), complex)
    for order, corner_hz, kind in (*high, *low):
        b, a = butter(order, 2 * np.pi * corner_hz, kind, analog=True)
        gains = gains * freqs(b, a, angular_frequencies)[1]
    return gains


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(
    ("high", "low"),
    [
        ((350e3, 2), None),
        ((700e3, 1), None),
        (None, (0.4, 4)),
        ((460e3, 3), (0.8, 5)),
        (None, (0.95, 2)),
    ],
)
def test_beats_match_analog_response_from_first_sample(radar, sampling, high, low):
    radar = set_sampling(radar, sampling)
    band_hz = radar.frame.chirp.max_beat_frequency_hz
    settings, highs, lows = {"high_pass_hz": None}, [], []
    if high is not None:
        settings |= {"high_pass_hz": high[0], "high_pass_order": high[1]}
        highs = [(high[1], high[0], "high")]
    if low is not None:
        settings |= {"low_pass_hz": low[0] * band_hz, "low_pass_order": low[1]}
        lows = [(low[1], low[0] * band_hz, "low")]
    beats_hz = np.linspace(1e4, 0.9 * band_hz, 60)
    filtered = filter_tones(radar, IfFilter(**settings), beats_hz)

    gains = compute_analog_gains(highs, lows, beats_hz)
    # Tolerance: 0.002 of the largest gain; real tones have a peak of sqrt(2).
    assert abs(filtered - build_expected_tones(radar, gains, beats_hz)).max() < 0.002 * np.sqrt(2)


def test_beat_above_half_sample_rate_is_not_negative_frequency(radar):
    low_pass = IfFilter(high_pass_hz=None, low_pass_hz=4e6, low_pass_order=4)
    power = abs(filter_tones(radar, low_pass, [2e6, 4e6, 6e6, 8e6])).mean(axis=1) ** 2
    # Response of an analog 4th-order low-pass; -2 MHz would pass without loss.
    measure_levels = -10 * np.log10(1 + np.array([0.5, 1, 1.5, 2]) ** 8)
    np.testing.assert_allclose(10 * np.log10(power), measure_levels, atol=0.35)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_high_pass_attenuates_leakage_near_dc_by_its_order(radar, sampling):
    radar = set_sampling(radar, sampling)
    filtered = filter_tones(radar, IfFilter(high_pass_hz=350e3, high_pass_order=2), [0.0, 7e3])
    assert abs(filtered[0]).max() < 1e-6
    # Expected (f / f_h)^2 = 68 dB; the correction for zero gain at DC is accurate to 2e-4 here.
    assert abs(filtered[1]).max() < 8e-4


def test_echoes_are_filtered_without_transient(radar):
    target = dc.Target(position_m=(20, 0, 0))
    scene = dc.Scene(targets=[target])
    high_pass = IfFilter(high_pass_hz=700e3, high_pass_order=2)
    clean = dc.simulate(scene, radar, impairments=(), dtype=np.complex128)
    cube = dc.simulate(scene, radar, impairments=[high_pass], dtype=np.complex128)
    ratio = cube.values / clean.values

    beat_hz = radar.frame.chirp.beat_frequency_hz(20.0)
    (gain,) = compute_analog_gains([(2, 700e3, "high")], [], [beat_hz])
    np.testing.assert_allclose(ratio, gain, atol=0.0025)
    assert cube.sizes == clean.sizes
    np.testing.assert_array_equal(cube.sample, clean.sample)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_filter_shapes_noise_listed_before_it_only(radar, sampling):
    radar = set_sampling(radar, sampling)
    band_hz = radar.frame.chirp.max_beat_frequency_hz
    filters = IfFilter(high_pass_hz=None, low_pass_hz=0.5 * band_hz, low_pass_order=6)

    def measure_levels(*impairments):
        cube = dc.simulate(dc.Scene(), radar, impairments=impairments, n_frames=4, seed=3).values
        power = np.mean(abs(np.fft.fft(cube)) ** 2, axis=(0, 1, 2))
        half = 128 if sampling == "real" else 256
        return power[: int(0.9 * half)]

    ratio_db = 10 * np.log10(
        measure_levels(ThermalNoise(), filters) / measure_levels(ThermalNoise())
    )
    share = np.arange(len(ratio_db)) / len(ratio_db) * 0.9
    # Means of 1024 powers: 0.2 dB; tolerance of five standard errors of a ratio. Sidelobes of the
    # rectangular window dominate where attenuation exceeds 25 dB.
    np.testing.assert_allclose(
        ratio_db[share < 0.7], -10 * np.log10(1 + (share[share < 0.7] / 0.5) ** 12), atol=1.0
    )
    ratio = measure_levels(filters, ThermalNoise()) / measure_levels(ThermalNoise())
    np.testing.assert_allclose(10 * np.log10(ratio), 0, atol=1.0)


def test_warns_of_echo_attenuated_by_filter(radar):
    near_scene = dc.Scene(
        targets=[
            dc.Target(name="bumper", position_m=(1.0, 0, 0)),
            dc.Target(name="wall", position_m=(20, 0, 0)),
        ]
    )
    # Beat frequency of 1 m: 133 kHz, attenuated by (133 / 350)^2: 17 dB.
    with pytest.warns(dc.PhysicsWarning, match=r"bumper is attenuated by 16\.\d dB.*0\.1334 MHz"):
        IfFilter(high_pass_hz=350e3).check(near_scene, radar)
    IfFilter(high_pass_hz=100e3, high_pass_order=1).check(near_scene, radar)


@pytest.mark.parametrize(
    ("sampling", "settings", "message"),
    [
        ("complex", {"low_pass_hz": 10e6}, "low_pass: 10 MHz.*below 10 MHz"),
        ("real", {"low_pass_hz": 6e6}, "low_pass: 6 MHz.*below 5 MHz"),
        ("real", {"high_pass_hz": 6e6}, "high_pass: 6 MHz"),
        ("complex", {"high_pass_hz": 10e3}, "high_pass: a corner so low.*settling within 35 us"),
        ("complex", {"high_pass_hz": None, "low_pass_hz": 10e3}, "low_pass: a corner so low"),
    ],
)
def test_rejects_filter_corner_outside_band(radar, sampling, settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        IfFilter(**settings).check(dc.Scene(), set_sampling(radar, sampling))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"high_pass_hz": None}, "IfFilter.high_pass_hz"),
        ({"high_pass_hz": 5e6, "low_pass_hz": 1e6}, "IfFilter.low_pass_hz"),
        ({"low_pass_order": 0}, "IfFilter.low_pass_order"),
        ({"high_pass_order": 9}, "IfFilter.high_pass_order"),
        ({"high_pass_hz": -1.0}, "IfFilter.high_pass_hz"),
    ],
)
def test_rejects_invalid_filter_settings(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        IfFilter(**settings)
