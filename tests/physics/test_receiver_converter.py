"""Analog-to-digital converter: quantisation, full scale, codes and aperture jitter."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.adc_codes import extract_adc_codes, has_adc_codes
from dechirp.simulation.impairments.aperture_jitter import ApertureJitter
from dechirp.simulation.impairments.channel_mismatch import ChannelMismatch
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.quantisation import Quantisation

EMPTY_SCENE = dc.Scene()


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def generate_tones(radar, power_w, cycles_per_sample, *, n_chirps=40, n_margin=0):
    """Generate one tone of a given power, at another phase in each chirp, with margins."""
    times = np.arange(256 + 2 * n_margin) - n_margin
    starts = np.arange(n_chirps)[:, None] * np.sqrt(2)
    waves = np.sqrt(power_w) * np.exp(2j * np.pi * (cycles_per_sample * times + starts))
    if radar.frame.chirp.sampling == "real":
        waves = np.sqrt(2) * waves.real
    return np.ascontiguousarray(np.repeat(waves[None, :, None], 2, axis=2))


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("bits", [6, 8, 10, 12, 14, 16])
def test_full_scale_tone_has_snr_of_its_bits(radar, sampling, bits):
    radar = set_sampling(radar, sampling)
    converter = Quantisation(bits=bits, full_scale_w=3e-6)
    clean = generate_tones(radar, 3e-6, 0.1931 * np.sqrt(3), n_chirps=200)
    quantised_samples = clean.copy()
    converter.apply_to_samples(quantised_samples, EMPTY_SCENE, radar, np.random.default_rng(0))

    noise_w = np.mean(abs(quantised_samples - clean) ** 2)
    snr_db = 10 * np.log10(np.mean(abs(clean) ** 2) / noise_w)
    assert snr_db == pytest.approx(6.02 * bits + 1.76, abs=0.3)
    assert noise_w == pytest.approx(converter.noise_power_w(EMPTY_SCENE, radar), rel=0.05)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_samples_beyond_full_scale_are_clipped_and_counted(radar, sampling):
    radar = set_sampling(radar, sampling)
    converter = Quantisation(bits=8, full_scale_w=1e-6)
    samples = generate_tones(radar, 4e-6, 0.381966)
    # Twice the full-scale amplitude exceeds it where |cos| > 1/2, two thirds of the time; the last
    # half step of 127 is not clipped.
    with pytest.warns(dc.PhysicsWarning, match=r"clips 66\.\d+% of"):
        converter.apply_to_samples(samples, EMPTY_SCENE, radar, np.random.default_rng(0))
    parts = np.unique(samples.view(float) / converter.step_size(radar)).round(6)
    assert parts.min() == -128
    assert parts.max() == 127


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("bits", [4, 12, 16])
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
def test_codes_times_scale_equal_samples(radar, sampling, bits, dtype):
    radar = set_sampling(radar, sampling)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    full_scale_w = 64 * ThermalNoise().noise_power_w(scene, radar)
    converter = Quantisation(bits=bits, full_scale_w=full_scale_w)
    cube = dc.simulate(scene, radar, impairments=[ThermalNoise(), converter], dtype=dtype, seed=2)

    codes = extract_adc_codes(cube)
    assert has_adc_codes(cube)
    assert codes.dtype == np.int16
    assert codes.attrs["bits"] == bits
    assert codes.dims == (*cube.dims, *(("iq",) if sampling == "complex" else ()))
    steps = codes.values * codes.attrs["scale"]
    samples = steps[..., 0] + 1j * steps[..., 1] if sampling == "complex" else steps
    np.testing.assert_allclose(cube.values, samples, rtol=1e-6)
    # Noise amplitude: an eighth of full scale; its peaks are four or five times higher.
    assert 2 ** (bits - 1) / 4 < abs(codes.values).max() <= 2 ** (bits - 1)
    np.testing.assert_array_equal(codes.sample, cube.sample)


def test_impairment_after_converter_removes_scale(radar):
    # A frame of zeros is a multiple of any step size, but later frames are not.
    impairments = [Quantisation(full_scale_w=1e-9), ChannelMismatch(gains=(1.0, 1.1))]
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=impairments)
    assert "scale" not in cube.attrs
    assert not has_adc_codes(cube)


def test_rejects_samples_that_are_not_codes(radar):
    noise = dc.simulate(EMPTY_SCENE, radar)
    with pytest.raises(dc.InvalidSetting, match="not ADC codes"):
        extract_adc_codes(noise)
    with pytest.raises(dc.InvalidSetting, match="not ADC codes"):
        extract_adc_codes(noise.assign_attrs(scale=1e-9))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bits": 1, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"bits": 17, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"bits": 12.5, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"full_scale_w": 0.0}, "Quantisation.full_scale_w"),
        ({"full_scale_w": -1e-6}, "Quantisation.full_scale_w"),
    ],
)
def test_rejects_invalid_bits_and_full_scale(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Quantisation(**settings)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.55, 0.8])
def test_jitter_noise_grows_with_tone_slope(radar, sampling, share):
    radar = set_sampling(radar, sampling)
    jitter, beat_hz = ApertureJitter(rms_s=1e-12), share * radar.frame.chirp.max_beat_frequency_hz
    n_margin = max(jitter.sample_margins(radar))
    clean = generate_tones(radar, 1.0, beat_hz / 10e6, n_margin=n_margin)
    jittered_samples = clean.copy()
    jitter.apply_to_samples(jittered_samples, EMPTY_SCENE, radar, np.random.default_rng(4))

    central_samples = slice(n_margin, n_margin + 256)
    snr = 1 / np.mean(abs(jittered_samples - clean)[..., central_samples] ** 2)
    expected_db = -20 * np.log10(2 * np.pi * beat_hz * 1e-12)
    # Mean of 20,000 squares: 0.05 dB. Slope error: 0.05 % of the steepest tone, which is 2.5 %,
    # 0.2 dB, of the flattest one here.
    assert 10 * np.log10(snr) == pytest.approx(expected_db, abs=0.3)


def test_jitter_predicts_its_noise_power(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(r, 0, 0)) for r in (20.0, 30.0)])
    jitter = ApertureJitter(rms_s=1e-12)
    cubes = [dc.simulate(scene, radar, impairments=impairments) for impairments in ([jitter], [])]
    added_w = float(np.mean(abs(cubes[0] - cubes[1]) ** 2))
    assert added_w == pytest.approx(jitter.noise_power_w(scene, radar), rel=0.05)


def test_rejects_jitter_beyond_sample_period(radar):
    with pytest.raises(dc.InvalidSetting, match=r"rms: 1e\+04 ps.*at most 4775 ps"):
        ApertureJitter(rms_s=1e-8).check(EMPTY_SCENE, radar)
    with pytest.raises(dc.InvalidSetting, match=r"ApertureJitter\.rms_s"):
        ApertureJitter(rms_s=-1e-12)
