"""The converter: steps, full scale, codes, and the instants of samples."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.adc_codes import extract_adc_codes, has_adc_codes
from dechirp.simulation.impairments.aperture_jitter import ApertureJitter
from dechirp.simulation.impairments.channel_mismatch import ChannelMismatch
from dechirp.simulation.impairments.quantisation import Quantisation
from dechirp.simulation.impairments.thermal_noise import ThermalNoise

EMPTY = dc.Scene()


def with_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def tones(radar, power_w, cycles_per_sample, *, n_chirps=40, wide=0):
    """The same tone in each chirp, of a power, from another phase; with more samples around it."""
    times = np.arange(256 + 2 * wide) - wide
    starts = np.arange(n_chirps)[:, None] * np.sqrt(2)
    waves = np.sqrt(power_w) * np.exp(2j * np.pi * (cycles_per_sample * times + starts))
    if radar.frame.chirp.sampling == "real":
        waves = np.sqrt(2) * waves.real
    return np.ascontiguousarray(np.repeat(waves[None, :, None], 2, axis=2))


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("bits", [6, 8, 10, 12, 14, 16])
def test_a_tone_of_full_scale_has_the_signal_to_noise_ratio_of_its_bits(radar, sampling, bits):
    radar = with_sampling(radar, sampling)
    converter = Quantisation(bits=bits, full_scale_w=3e-6)
    clean = tones(radar, 3e-6, 0.1931 * np.sqrt(3), n_chirps=200)
    coarse = clean.copy()
    converter.apply_to_samples(coarse, EMPTY, radar, np.random.default_rng(0))

    noise_w = np.mean(abs(coarse - clean) ** 2)
    snr_db = 10 * np.log10(np.mean(abs(clean) ** 2) / noise_w)
    assert snr_db == pytest.approx(6.02 * bits + 1.76, abs=0.3)
    assert noise_w == pytest.approx(converter.noise_power_w(EMPTY, radar), rel=0.05)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_what_exceeds_full_scale_is_clipped_and_counted(radar, sampling):
    radar = with_sampling(radar, sampling)
    converter = Quantisation(bits=8, full_scale_w=1e-6)
    samples = tones(radar, 4e-6, 0.381966)
    # Twice the amplitude: beyond full scale where |cos| > 1/2, two thirds of the time; half a
    # step of 127 more is not clipped.
    with pytest.warns(dc.PhysicsWarning, match=r"clips 66\.\d+% of"):
        converter.apply_to_samples(samples, EMPTY, radar, np.random.default_rng(0))
    parts = np.unique(samples.view(float) / converter.step_size(radar)).round(6)
    assert parts.min() == -128
    assert parts.max() == 127


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("bits", [4, 12, 16])
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
def test_codes_are_the_samples_in_steps(radar, sampling, bits, dtype):
    radar = with_sampling(radar, sampling)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    full_scale_w = 64 * ThermalNoise().noise_power_w(scene, radar)
    converter = Quantisation(bits=bits, full_scale_w=full_scale_w)
    cube = dc.simulate(scene, radar, impairments=[ThermalNoise(), converter], dtype=dtype, seed=2)

    made = extract_adc_codes(cube)
    assert has_adc_codes(cube)
    assert made.dtype == np.int16
    assert made.attrs["bits"] == bits
    assert made.dims == (*cube.dims, *(("iq",) if sampling == "complex" else ()))
    steps = made.values * made.attrs["scale"]
    samples = steps[..., 0] + 1j * steps[..., 1] if sampling == "complex" else steps
    np.testing.assert_allclose(cube.values, samples, rtol=1e-6)
    # Noise at an eighth of full scale in amplitude, and four or five times that at its peaks.
    assert 2 ** (bits - 1) / 4 < abs(made.values).max() <= 2 ** (bits - 1)
    np.testing.assert_array_equal(made.sample, cube.sample)


def test_a_cube_has_no_scale_where_samples_are_changed_after_the_converter(radar):
    # All zero, and so whole numbers of whatever step, though later frames are not.
    after = [Quantisation(full_scale_w=1e-9), ChannelMismatch(gains=(1.0, 1.1))]
    cube = dc.simulate(EMPTY, radar, impairments=after)
    assert "scale" not in cube.attrs
    assert not has_adc_codes(cube)


def test_samples_that_are_no_codes_are_refused(radar):
    noise = dc.simulate(EMPTY, radar)
    with pytest.raises(dc.InvalidSetting, match="not ADC codes"):
        extract_adc_codes(noise)
    with pytest.raises(dc.InvalidSetting, match="not ADC codes"):
        extract_adc_codes(noise.assign_attrs(scale=1e-9))


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"bits": 1, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"bits": 17, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"bits": 12.5, "full_scale_w": 1.0}, "Quantisation.bits"),
        ({"full_scale_w": 0.0}, "Quantisation.full_scale_w"),
        ({"full_scale_w": -1e-6}, "Quantisation.full_scale_w"),
    ],
)
def test_a_converter_has_2_to_16_bits_and_a_full_scale(settings, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        Quantisation(**settings)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.55, 0.8])
def test_jitter_adds_noise_as_steep_tones_ask_for(radar, sampling, share):
    radar = with_sampling(radar, sampling)
    jitter, beat_hz = ApertureJitter(rms_s=1e-12), share * radar.frame.chirp.max_beat_frequency_hz
    wide = max(jitter.sample_margins(radar))
    clean = tones(radar, 1.0, beat_hz / 10e6, wide=wide)
    late = clean.copy()
    jitter.apply_to_samples(late, EMPTY, radar, np.random.default_rng(4))

    kept = slice(wide, wide + 256)
    snr = 1 / np.mean(abs(late - clean)[..., kept] ** 2)
    expected_db = -20 * np.log10(2 * np.pi * beat_hz * 1e-12)
    # The mean of 20,000 squares: 0.05 dB; the slope is right to 0.05 % of the
    # steepest, which is 2.5 %, 0.2 dB, of the flattest here.
    assert 10 * np.log10(snr) == pytest.approx(expected_db, abs=0.3)


def test_jitter_says_what_noise_it_adds_to_echoes(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(r, 0, 0)) for r in (20.0, 30.0)])
    jitter = ApertureJitter(rms_s=1e-12)
    cubes = [dc.simulate(scene, radar, impairments=one) for one in ([jitter], [])]
    added_w = float(np.mean(abs(cubes[0] - cubes[1]) ** 2))
    assert added_w == pytest.approx(jitter.noise_power_w(scene, radar), rel=0.05)


def test_jitter_of_the_wrong_unit_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match=r"rms: 1e\+04 ps.*at most 4775 ps"):
        ApertureJitter(rms_s=1e-8).check(EMPTY, radar)
    with pytest.raises(dc.InvalidSetting, match=r"ApertureJitter\.rms_s"):
        ApertureJitter(rms_s=-1e-12)
