"""Receiver compression: gain at the compression point, intermodulation and saturation."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.impairments.compression import Compression

P1DB_W = 1e-4


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def compress_tones(radar, powers_w, *, dtype=np.complex128):
    """Compress tones of 30, 37, ... cycles; return their power spectrum."""
    phase = 2 * np.pi * np.arange(256) / 256
    wave = sum(
        np.sqrt(power_w) * np.exp(1j * ((30 + 7 * k) * phase + 0.3 * k))
        for k, power_w in enumerate(powers_w)
    )
    if radar.frame.chirp.sampling == "real":
        wave, dtype = np.sqrt(2) * wave.real, dtype(0).real.dtype
    samples = np.tile(wave, (1, 3, 2, 1)).astype(dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        Compression(p1db_w=P1DB_W).apply_to_samples(
            samples, dc.Scene(), radar, np.random.default_rng(0)
        )
    assert (samples == samples[0, 0, 0]).all()
    power = abs(np.fft.fft(samples[0, 0, 0]) / 256) ** 2
    # Real tones have half of their power at the mirrored frequency.
    return power if np.iscomplexobj(samples) else 2 * power


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
def test_tone_at_compression_point_loses_1_db(radar, sampling, dtype):
    radar = set_sampling(radar, sampling)
    gain = compress_tones(radar, [P1DB_W], dtype=dtype)[30] / P1DB_W
    assert 10 * np.log10(gain) == pytest.approx(-1, abs=1e-3)
    weak_gain = compress_tones(radar, [P1DB_W / 1e4], dtype=dtype)[30] / (P1DB_W / 1e4)
    assert 10 * np.log10(weak_gain) == pytest.approx(0, abs=2e-4)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("backoff_db", [15.0, 25.0, 40.0])
def test_two_tone_products_follow_third_order_intercept(radar, sampling, backoff_db):
    radar, tone_w = set_sampling(radar, sampling), P1DB_W / 10 ** (backoff_db / 10)
    power = compress_tones(radar, [tone_w, tone_w])
    # Each product lies below its tones by twice their distance from the intercept.
    suppression_db = 2 * (9.64 + backoff_db)
    for product, parent in ((23, 30), (44, 37)):
        ratio_db = 10 * np.log10(power[product] / power[parent])
        # The tones themselves are compressed, by 0.1 dB at 15 dB.
        assert ratio_db == pytest.approx(-suppression_db, abs=0.2)


def test_tone_power_is_constant_beyond_saturation(radar):
    last_w = P1DB_W / (3 * (1 - 10 ** (-1 / 20)))
    saturation_power, overdriven_power = (
        compress_tones(radar, [last_w * ratio])[30] for ratio in (1.0, 100.0)
    )
    assert 10 * np.log10(overdriven_power / saturation_power) == pytest.approx(0, abs=1e-6)
    levels = [compress_tones(radar, [last_w * ratio])[30] for ratio in np.linspace(0.5, 1.5, 41)]
    assert (np.diff(levels) > -1e-15).all()
    assert np.abs(np.diff(levels, 2)).max() < 0.01 * saturation_power  # no step, no corner


def test_warns_of_strong_echoes(radar):
    near_scene = dc.Scene(targets=[dc.Target(position_m=(5, 0, 0), rcs_m2=100.0)])
    echo_w = np.max(abs(dc.simulate(near_scene, radar, impairments=()).values) ** 2)
    with pytest.warns(dc.PhysicsWarning, match=r"compression\.p1db.* 3 dB below"):
        dc.simulate(near_scene, radar, impairments=[Compression(p1db_w=2 * echo_w)])
    with pytest.warns(dc.PhysicsWarning, match="7 dB above"):
        dc.simulate(near_scene, radar, impairments=[Compression(p1db_w=echo_w / 5)])
    dc.simulate(near_scene, radar, impairments=[Compression(p1db_w=5 * echo_w)])


@pytest.mark.parametrize("power_w", [0.0, -1e-3, float("nan")])
def test_rejects_invalid_compression_point(power_w):
    with pytest.raises(dc.InvalidSetting, match=r"Compression\.p1db_w"):
        Compression(p1db_w=power_w)
