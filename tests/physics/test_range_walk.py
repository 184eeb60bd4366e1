"""Range walk: loss of fast targets in long frames, and its compensation."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.range_walk import select_frame_transform
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from nightly import nightly, nightly_except

N_SAMPLES, N_CHIRPS = 300, 128


def build_radar(sampling="complex"):
    """Build a radar with 3 GHz in 30 us: cells of 5 cm, frames of 3.5 ms."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=1e14,
        adc_start_s=1e-6,
        ramp_duration_s=32e-6,
        sample_rate_hz=10e6,
        n_samples=N_SAMPLES,
        sampling=sampling,
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=N_CHIRPS, interval_s=34e-6),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=10.0),
    )


def simulate_echo(radar, velocity_m_per_s, range_m=6.0):
    target = dc.Target(
        position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), rcs_m2=1.0
    )
    return dc.simulate(dc.Scene(targets=[target]), radar, impairments=()).values[0]


def build_transforms(window, pad=4):
    """Build transforms padded fourfold: scalloping loss at most 0.25 dB per axis."""
    return (
        Transform(window=window, n_points=N_SAMPLES, n_bins=pad * N_SAMPLES),
        Transform(window=window, n_points=N_CHIRPS, n_bins=pad * N_CHIRPS),
    )


def measure_peak_db(power, samples):
    """Measure the peak of a map over the mean sample power: 0 for a tone on a bin."""
    return 10 * np.log10(power.max() / np.mean(abs(samples) ** 2))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize(
    "velocity_m_per_s", nightly_except([-25.0, 4.0], [-25.0, -11.0, 0.0, 4.0, 24.0])
)
@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_range_walk_compensation_restores_gain(name, velocity_m_per_s, window, sampling):
    radar = build_radar(sampling)
    samples = simulate_echo(radar, velocity_m_per_s)
    range_transform, doppler_transform = build_transforms(window)

    arguments = samples, sampling, range_transform, doppler_transform
    plain_db = measure_peak_db(mean_range_doppler_power(*arguments), samples)
    compensated_db = measure_peak_db(
        mean_range_doppler_power(*arguments, select_frame_transform(name, radar.frame.chirp)),
        samples,
    )

    assert compensated_db == pytest.approx(0, abs=0.5)
    walk = abs(velocity_m_per_s) * N_CHIRPS * radar.frame.interval_s / 0.05
    if walk > 1.9:  # two cells cost 4 dB; tapers, which emphasise mid-frame, lose less
        assert plain_db < (-3.9 if window == "rectangular" else -0.7)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_peak_range_is_range_at_mid_frame(name):
    radar = build_radar()
    velocity_m_per_s, chirp = 20.0, radar.frame.chirp
    range_transform, doppler_transform = build_transforms("hann")
    samples, transform = simulate_echo(radar, velocity_m_per_s), select_frame_transform(name, chirp)
    power = mean_range_doppler_power(
        samples, "complex", range_transform, doppler_transform, transform
    )

    velocity, row = np.unravel_index(power.argmax(), power.shape)

    step = np.diff(radar.frame.velocity_bins_m_per_s(doppler_transform.n_bins))[0]
    velocity_m_per_s_peak = radar.frame.velocity_bins_m_per_s(doppler_transform.n_bins)[velocity]
    assert velocity_m_per_s_peak == pytest.approx(velocity_m_per_s, abs=step)
    coupling_m = velocity_m_per_s * chirp.mean_sampled_frequency_hz / chirp.slope_hz_per_s
    mid_frame_m = 6.0 + velocity_m_per_s * radar.frame.mid_frame_s
    cell_m = chirp.range_bins_m(range_transform.n_bins)[1]
    assert chirp.range_bins_m(range_transform.n_bins)[row] == pytest.approx(
        mid_frame_m + coupling_m, abs=cell_m
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_keystone_equals_direct_sum_over_chirps(sampling):
    radar = build_radar(sampling)
    chirp, rng = radar.frame.chirp, np.random.default_rng(3)
    samples = rng.standard_normal((N_CHIRPS, 2, N_SAMPLES)).astype(np.float32)
    if sampling == "complex":
        samples = samples + 1j * rng.standard_normal(samples.shape).astype(np.float32)
    range_transform, doppler_transform = build_transforms("hann", pad=2)
    spectrum = select_frame_transform("keystone", chirp)(
        samples, sampling, range_transform, doppler_transform
    )

    transmit_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * (
        chirp.adc_start_s + np.arange(N_SAMPLES) / chirp.sample_rate_hz
    )
    m, n = np.arange(N_CHIRPS) - (N_CHIRPS - 1) / 2, np.arange(N_SAMPLES)
    gain = np.sqrt(1 if sampling == "complex" else 2)
    for velocity, row in [(0, 0), (37, 211), (128, 5), (255, 299)]:
        per_chirp = 2 * np.pi * (velocity - N_CHIRPS) / doppler_transform.n_bins
        per_sample = 2 * np.pi * row / range_transform.n_bins
        phases = np.outer(m, per_chirp * transmit_hz / transmit_hz.mean()) + per_sample * n
        weights = np.outer(doppler_transform.weights, range_transform.weights)
        weights *= gain / weights.sum()
        expected = np.einsum("mkn,mn->k", samples, weights * np.exp(-1j * phases))
        # Single precision: 1e-6 of the RMS noise in a cell.
        assert spectrum[velocity, :, row] == pytest.approx(
            expected, abs=1e-4 * float(abs(spectrum).mean())
        )


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity_m_per_s", nightly_except(1, [-25.0, 4.0, 11.0]))
@pytest.mark.parametrize("pad", [1, 2])
def test_segmented_transform_adds_no_lobes_to_keystone(sampling, velocity_m_per_s, pad):
    radar = build_radar(sampling)
    arguments = simulate_echo(radar, velocity_m_per_s), sampling, *build_transforms("hann", pad)

    keystone = abs(select_frame_transform("keystone", radar.frame.chirp)(*arguments))
    segmented = abs(select_frame_transform("segmented", radar.frame.chirp)(*arguments))

    # Taper over w = 4 steps with up to a quarter of a cycle per step: exp(-pi w sqrt(1/2)), 78 dB,
    # times two for the alias on the other side. Adjacent segments gave 28 to 40 dB.
    assert abs(segmented - keystone).max() < 2 * np.exp(-np.pi * 4 * np.sqrt(0.5)) * keystone.max()


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("range_walk", ["keystone", "segmented"])
def test_strong_walking_target_is_one_detection(range_walk):
    radar = build_radar()
    target = dc.Target(position_m=(6, 0, 0), velocity_m_per_s=(11, 0, 0), rcs_m2=10)
    cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=1)

    detections = dc.detect(cube, radar, dc.Chain(range_walk=range_walk))

    assert detections.sizes["detection"] == 1
    assert detections.snr.item() > 5e6  # 67 dB: adjacent segments gave thirteen lobes above it
    assert detections.velocity.item() == pytest.approx(11, abs=0.01)


@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_compensation_keeps_noise_power(name):
    radar = build_radar()
    rng = np.random.default_rng(5)
    samples = rng.standard_normal((2, N_CHIRPS, 2, N_SAMPLES)).astype(np.float32)
    noise = np.asarray(samples[0] + 1j * samples[1], np.complex64)
    range_transform, doppler_transform = build_transforms("rectangular", pad=1)
    arguments = noise, "complex", range_transform, doppler_transform
    plain_power = mean_range_doppler_power(*arguments).mean()

    compensated_power = mean_range_doppler_power(
        *arguments, select_frame_transform(name, radar.frame.chirp)
    ).mean()

    # 76,800 independent cells; five standard deviations of their mean.
    assert compensated_power / plain_power == pytest.approx(
        1, abs=5 / np.sqrt(2 * N_CHIRPS * N_SAMPLES)
    )


@nightly
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("range_walk", [None, "keystone", "segmented"])
def test_estimates_of_walking_target_reach_bound(range_walk):
    radar = build_radar()
    target = dc.Target(position_m=(6, 0, 0), velocity_m_per_s=(24, 0, 0), rcs_m2=1e-3)
    chain = dc.Chain(range_walk=range_walk)
    ground_truth = dc.truth(dc.Scene(targets=[target]), radar)
    squared_errors = {"range": [], "velocity": []}
    for seed in range(40):
        cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=seed)
        detections = dc.detect(cube, radar, chain)
        strongest = detections.isel(detection=int(np.argmax(detections.snr.values)))
        for name, errors in squared_errors.items():
            error = float(strongest[name]) - float(ground_truth[name].squeeze())
            errors.append((error / float(strongest[f"{name}_std"])) ** 2)

    # Chi-squared of 40 degrees of freedom is outside 0.21 to 2.3 of its mean once in 1e6.
    for errors in squared_errors.values():
        assert 0.2 < np.mean(errors) < 2.3
