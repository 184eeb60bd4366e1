"""Interference repair of single chirps by fitted tones, against the Cramer-Rao bound."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

import dechirp as dc
from dechirp.processing.mitigation.interference_tones import InterferenceTones
from dechirp.processing.mitigation.tone_fit import fit_tones_outside_bursts

N_SAMPLES, NOISE_POWER = 1024, 0.01
FREQUENCIES = np.array([0.031, 0.0337, 0.21])  # of a sample; the first two 2.8 cells apart
AMPLITUDES = np.array([1.0, 0.3, 0.1])
BURSTS = [slice(100, 260), slice(500, 640), slice(900, 1000)]  # 39 % of the samples


def make_chirp(rng, *, sampling="complex", n_rx=1, burst_power=30.0):
    """Return clean echoes and disturbed samples, (rx, sample)."""
    times = np.arange(N_SAMPLES)
    phases = rng.uniform(0, 2 * np.pi, (n_rx, len(FREQUENCIES), 1))
    clean = np.einsum(
        "t,rtn->rn", AMPLITUDES, np.exp(1j * (2 * np.pi * np.outer(FREQUENCIES, times) + phases))
    )
    shape = (2, n_rx, N_SAMPLES)
    real, imag = rng.normal(scale=np.sqrt(NOISE_POWER / 2), size=shape)
    noise = real + 1j * imag
    burst = np.sqrt(burst_power) * np.exp(1j * np.pi * 2e-3 * (times - 300.0) ** 2)
    is_burst = np.zeros(N_SAMPLES, bool)
    for part in BURSTS:
        is_burst[part] = True
    disturbed = clean + noise + burst * is_burst
    if sampling == "real":
        return np.sqrt(2) * clean.real, np.sqrt(2) * disturbed.real, is_burst
    return clean, disturbed, is_burst


@pytest.mark.parametrize("burst_power", [0.3, 30.0, 3e3])
@pytest.mark.parametrize(("sampling", "n_rx"), [("complex", 1), ("complex", 4), ("real", 1)])
def test_echoes_reach_the_bound_of_the_samples_outside_bursts(sampling, n_rx, burst_power):
    rng = np.random.default_rng(5)
    clean, disturbed, is_burst = make_chirp(
        rng, sampling=sampling, n_rx=n_rx, burst_power=burst_power
    )

    fit = fit_tones_outside_bursts(disturbed)

    # Bursts end where noise explains the samples, some of which they have at their ends.
    assert np.mean(fit.is_burst != is_burst) < 0.03
    error = np.mean(np.abs(fit.tones - clean)[:, ~is_burst] ** 2)
    # Of the noise, tones take what fits their real unknowns: a frequency, and an amplitude and a
    # phase in each receiver. Over its mean, that is a chi-square variable.
    n_unknown = len(FREQUENCIES) * (2 * n_rx + 1)
    n_numbers = n_rx * np.sum(~is_burst) * (2 if sampling == "complex" else 1)
    largest = scipy.stats.chi2.isf(1e-6, n_unknown) / n_unknown
    assert error < largest * NOISE_POWER * n_unknown / n_numbers
    # Within bursts, the tones are interpolated, with errors up to a few times larger.
    assert np.mean(np.abs(fit.tones - clean)[:, is_burst] ** 2) < 6 * error


def test_noise_alone_has_neither_tones_nor_bursts():
    rng = np.random.default_rng(2)
    for _ in range(200):
        noise = rng.normal(size=(1, 256)) + 1j * rng.normal(size=(1, 256))
        fit = fit_tones_outside_bursts(noise)
        assert not fit.is_burst.any()
        assert not fit.tones.any()


def make_single_chirp_radar(radar):
    chirp = replace(radar.frame.chirp, sampling="complex")
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=1))


def test_chain_repairs_a_frame_of_one_chirp_and_keeps_others_bit_identical(radar):
    radar = make_single_chirp_radar(radar)
    target = dc.Target(position_m=(20.0, 0, 0), rcs_m2=1000.0)
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, impairments=(dc.impairments.ThermalNoise(),), seed=3)
    samples = cube.isel(frame=0).values
    disturbed = samples.copy()
    middle = samples.shape[2] // 2
    burst = slice(middle, middle + samples.shape[2] // 5)
    disturbed[..., burst] += 100 * np.abs(samples).max()

    repaired = InterferenceTones().clean(disturbed, radar.frame)

    assert np.array_equal(InterferenceTones().clean(samples, radar.frame), samples)
    is_outside = np.ones(samples.shape[2], bool)
    is_outside[burst.start - 5 : burst.stop + 5] = False
    assert np.array_equal(repaired[..., is_outside], samples[..., is_outside])
    difference = np.mean(np.abs(repaired - samples) ** 2) / np.mean(np.abs(samples) ** 2)
    assert difference < 0.1  # the noise of a fifth of the samples; a hundred before, squared


def test_chirps_without_their_noise_are_the_tones_of_the_whole_chirp(radar):
    rng = np.random.default_rng(5)
    _, disturbed, _ = make_chirp(rng)
    duration_s = 2 * N_SAMPLES / radar.frame.chirp.sample_rate_hz
    chirp = replace(
        radar.frame.chirp, sampling="complex", n_samples=N_SAMPLES, ramp_duration_s=duration_s
    )
    frame = dc.Frame(chirp=chirp, n_chirps=2, interval_s=duration_s)
    quiet = 0.1 * rng.normal(size=N_SAMPLES) + 0.1j * rng.normal(size=N_SAMPLES)
    samples = np.stack([disturbed, quiet[None]]).astype(np.complex64)

    cleaned = InterferenceTones(keep_noise=False).clean(samples, frame)

    tones = fit_tones_outside_bursts(samples[0]).tones
    assert np.allclose(cleaned[0], tones, atol=1e-6)
    assert np.array_equal(cleaned[1], samples[1])  # no burst: unchanged
    radar = replace(radar, frame=frame)
    (finding,) = InterferenceTones(keep_noise=False).limitation_findings(radar)
    assert "keep_noise" in str(finding)


@pytest.mark.parametrize(
    ("n_chirps", "n_samples", "expected"),
    [(3, 256, None), (4, 256, "frames of 4 chirps"), (1, 8, "and 8 samples")],
)
def test_findings_name_a_better_method(radar, n_chirps, n_samples, expected):
    chirp = replace(radar.frame.chirp, n_samples=n_samples)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=n_chirps))

    findings = InterferenceTones().limitation_findings(radar)

    if expected is None:
        assert findings == []
    else:
        (finding,) = findings
        assert expected in str(finding)
