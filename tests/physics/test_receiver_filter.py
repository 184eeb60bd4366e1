"""The filters before the converter, at the analog frequencies of the beats."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, freqs

import dechirp as dc
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.thermal_noise import ThermalNoise

RATE_HZ = 10e6


def with_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def filtered(radar, impairment, beats_hz):
    """Tones of power 1, one a chirp, from the first kept sample on: (n_tones, n_samples)."""
    before, after = impairment.sample_margins(radar)
    times_s = (np.arange(256 + before + after) - before) / RATE_HZ
    waves = np.exp(2j * np.pi * np.asarray(beats_hz)[:, None] * times_s)
    if radar.frame.chirp.sampling == "real":
        waves = np.sqrt(2) * waves.real
    samples = np.ascontiguousarray(waves[None, :, None, :])
    impairment.apply_to_samples(samples, dc.Scene(), radar, np.random.default_rng(0))
    return samples[0, :, 0, before : before + 256]


def expected(radar, gains, beats_hz):
    times_s = np.arange(256) / RATE_HZ
    waves = gains[:, None] * np.exp(2j * np.pi * np.asarray(beats_hz)[:, None] * times_s)
    return waves if radar.frame.chirp.sampling == "complex" else np.sqrt(2) * waves.real


def analog(high, low, beats_hz):
    """Complex gains of SciPy's analog Butterworth filters."""
    at = 2 * np.pi * np.asarray(beats_hz)
    gains = np.ones(len(at), complex)
    for order, corner_hz, kind in (*high, *low):
        b, a = butter(order, 2 * np.pi * corner_hz, kind, analog=True)
        gains = gains * freqs(b, a, at)[1]
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
def test_beats_meet_the_analog_response_from_the_first_sample_on(radar, sampling, high, low):
    radar = with_sampling(radar, sampling)
    band_hz = radar.frame.chirp.max_beat_frequency_hz
    settings, highs, lows = {"high_pass_hz": None}, [], []
    if high is not None:
        settings |= {"high_pass_hz": high[0], "high_pass_order": high[1]}
        highs = [(high[1], high[0], "high")]
    if low is not None:
        settings |= {"low_pass_hz": low[0] * band_hz, "low_pass_order": low[1]}
        lows = [(low[1], low[0] * band_hz, "low")]
    beats_hz = np.linspace(1e4, 0.9 * band_hz, 60)
    got = filtered(radar, IfFilter(**settings), beats_hz)

    gains = analog(highs, lows, beats_hz)
    # 0.002 of the largest gain is the tolerance; a real tone's peak is sqrt(2).
    assert abs(got - expected(radar, gains, beats_hz)).max() < 0.002 * np.sqrt(2)


def test_a_beat_above_half_the_sample_rate_is_no_negative_frequency(radar):
    passed = IfFilter(high_pass_hz=None, low_pass_hz=4e6, low_pass_order=4)
    power = abs(filtered(radar, passed, [2e6, 4e6, 6e6, 8e6])).mean(axis=1) ** 2
    # As an analog 4th order low-pass has it; -2 MHz would come through whole.
    levels = -10 * np.log10(1 + np.array([0.5, 1, 1.5, 2]) ** 8)
    np.testing.assert_allclose(10 * np.log10(power), levels, atol=0.35)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_leakage_near_frequency_0_is_cut_as_the_order_says(radar, sampling):
    radar = with_sampling(radar, sampling)
    cut = filtered(radar, IfFilter(high_pass_hz=350e3, high_pass_order=2), [0.0, 7e3])
    assert abs(cut[0]).max() < 1e-6
    # Like (f / f_h)^2 = 68 dB; the correction that makes it 0 at 0 is good to 2e-4 here.
    assert abs(cut[1]).max() < 8e-4


def test_echoes_are_filtered_without_a_transient(radar):
    target = dc.Target(position_m=(20, 0, 0))
    scene = dc.Scene(targets=[target])
    stop = IfFilter(high_pass_hz=700e3, high_pass_order=2)
    clean = dc.simulate(scene, radar, impairments=(), dtype=np.complex128)
    cube = dc.simulate(scene, radar, impairments=[stop], dtype=np.complex128)
    ratio = cube.values / clean.values

    beat_hz = radar.frame.chirp.beat_frequency_hz(20.0)
    (gain,) = analog([(2, 700e3, "high")], [], [beat_hz])
    np.testing.assert_allclose(ratio, gain, atol=0.0025)
    assert cube.sizes == clean.sizes
    np.testing.assert_array_equal(cube.sample, clean.sample)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_noise_that_is_listed_before_is_filtered_too(radar, sampling):
    radar = with_sampling(radar, sampling)
    band_hz = radar.frame.chirp.max_beat_frequency_hz
    filters = IfFilter(high_pass_hz=None, low_pass_hz=0.5 * band_hz, low_pass_order=6)

    def levels(*impairments):
        cube = dc.simulate(dc.Scene(), radar, impairments=impairments, n_frames=4, seed=3).values
        power = np.mean(abs(np.fft.fft(cube)) ** 2, axis=(0, 1, 2))
        half = 128 if sampling == "real" else 256
        return power[: int(0.9 * half)]

    ratio_db = 10 * np.log10(levels(ThermalNoise(), filters) / levels(ThermalNoise()))
    share = np.arange(len(ratio_db)) / len(ratio_db) * 0.9
    # Means of 1024 powers: 0.2 dB, five standard errors of the ratio of two. A rectangular
    # window leaks what is 25 dB stronger where much is cut.
    np.testing.assert_allclose(
        ratio_db[share < 0.7], -10 * np.log10(1 + (share[share < 0.7] / 0.5) ** 12), atol=1.0
    )
    before = levels(filters, ThermalNoise()) / levels(ThermalNoise())
    np.testing.assert_allclose(10 * np.log10(before), 0, atol=1.0)


def test_an_echo_that_the_filter_cuts_is_told_of(radar):
    near = dc.Scene(
        targets=[
            dc.Target(name="bumper", position_m=(1.0, 0, 0)),
            dc.Target(name="wall", position_m=(20, 0, 0)),
        ]
    )
    # 1 m beats at 133 kHz, as (133 / 350)^2: 17 dB.
    with pytest.warns(dc.PhysicsWarning, match=r"bumper is attenuated by 16\.\d dB.*0\.1334 MHz"):
        IfFilter(high_pass_hz=350e3).check(near, radar)
    IfFilter(high_pass_hz=100e3, high_pass_order=1).check(near, radar)


@pytest.mark.parametrize(
    ("sampling", "settings", "named"),
    [
        ("complex", {"low_pass_hz": 10e6}, "low_pass: 10 MHz.*below 10 MHz"),
        ("real", {"low_pass_hz": 6e6}, "low_pass: 6 MHz.*below 5 MHz"),
        ("real", {"high_pass_hz": 6e6}, "high_pass: 6 MHz"),
        ("complex", {"high_pass_hz": 10e3}, "high_pass: a corner so low.*settling within 35 us"),
        ("complex", {"high_pass_hz": None, "low_pass_hz": 10e3}, "low_pass: a corner so low"),
    ],
)
def test_filters_outside_the_band_are_refused_by_the_name_of_the_corner(
    radar, sampling, settings, named
):
    with pytest.raises(dc.InvalidSetting, match=named):
        IfFilter(**settings).check(dc.Scene(), with_sampling(radar, sampling))


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"high_pass_hz": None}, "IfFilter.high_pass_hz"),
        ({"high_pass_hz": 5e6, "low_pass_hz": 1e6}, "IfFilter.low_pass_hz"),
        ({"low_pass_order": 0}, "IfFilter.low_pass_order"),
        ({"high_pass_order": 9}, "IfFilter.high_pass_order"),
        ({"high_pass_hz": -1.0}, "IfFilter.high_pass_hz"),
    ],
)
def test_filters_that_are_none_are_refused(settings, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        IfFilter(**settings)
