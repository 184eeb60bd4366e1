"""Range walk: what a fast target loses within a long frame, and gets back."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.range_walk import frame_transform
from dechirp.processing.spectrum import Transform, mean_power

N_SAMPLES, N_CHIRPS = 300, 128


def radar(sampling="complex"):
    """3 GHz within 30 us: cells of 5 cm, 3.5 ms a frame."""
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


def echo(of, velocity_m_per_s, range_m=6.0):
    target = dc.Target(
        position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), rcs_m2=1.0
    )
    return dc.simulate(dc.Scene(targets=[target]), of, impairments=()).values[0]


def transforms(window, pad=4):
    """Padded fourfold: between bins a peak then loses at most 0.25 dB on each axis."""
    return (
        Transform(window=window, n_points=N_SAMPLES, n_bins=pad * N_SAMPLES),
        Transform(window=window, n_points=N_CHIRPS, n_bins=pad * N_CHIRPS),
    )


def peak_db(power, samples):
    """Peak of a map over the mean power of the samples: 0 for a tone on a bin."""
    return 10 * np.log10(power.max() / np.mean(abs(samples) ** 2))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("window", ["rectangular", "hann"])
@pytest.mark.parametrize("velocity_m_per_s", [-25.0, -11.0, 0.0, 4.0, 24.0])
@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_a_target_that_walks_gets_its_gain_back(name, velocity_m_per_s, window, sampling):
    of = radar(sampling)
    samples = echo(of, velocity_m_per_s)
    over_range, over_velocity = transforms(window)

    how = samples, sampling, over_range, over_velocity
    plain_db = peak_db(mean_power(*how), samples)
    undone_db = peak_db(mean_power(*how, frame_transform(name, of.frame.chirp)), samples)

    assert undone_db == pytest.approx(0, abs=0.5)
    walk = abs(velocity_m_per_s) * N_CHIRPS * of.frame.interval_s / 0.05
    if walk > 1.9:  # two cells cost 4 dB without windows, which favour mid-frame
        assert plain_db < (-3.9 if window == "rectangular" else -0.7)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_the_range_is_that_at_mid_frame(name):
    of = radar()
    velocity_m_per_s, chirp = 20.0, of.frame.chirp
    over_range, over_velocity = transforms("hann")
    samples, undone = echo(of, velocity_m_per_s), frame_transform(name, chirp)
    power = mean_power(samples, "complex", over_range, over_velocity, undone)

    velocity, row = np.unravel_index(power.argmax(), power.shape)

    step = np.diff(of.frame.velocity_bins_m_per_s(over_velocity.n_bins))[0]
    found = of.frame.velocity_bins_m_per_s(over_velocity.n_bins)[velocity]
    assert found == pytest.approx(velocity_m_per_s, abs=step)
    coupling_m = velocity_m_per_s * chirp.mean_sampled_frequency_hz / chirp.slope_hz_per_s
    mid_frame_m = 6.0 + velocity_m_per_s * of.frame.mid_frame_s
    cell_m = chirp.range_bins_m(over_range.n_bins)[1]
    assert chirp.range_bins_m(over_range.n_bins)[row] == pytest.approx(
        mid_frame_m + coupling_m, abs=cell_m
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_the_keystone_is_the_sum_over_chirps_at_the_frequencies_of_each_sample(sampling):
    of = radar(sampling)
    chirp, rng = of.frame.chirp, np.random.default_rng(3)
    samples = rng.standard_normal((N_CHIRPS, 2, N_SAMPLES)).astype(np.float32)
    if sampling == "complex":
        samples = samples + 1j * rng.standard_normal(samples.shape).astype(np.float32)
    over_range, over_velocity = transforms("hann", pad=2)
    found = frame_transform("keystone", chirp)(samples, sampling, over_range, over_velocity)

    sent_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * (
        chirp.adc_start_s + np.arange(N_SAMPLES) / chirp.sample_rate_hz
    )
    m, n = np.arange(N_CHIRPS) - (N_CHIRPS - 1) / 2, np.arange(N_SAMPLES)
    gain = np.sqrt(1 if sampling == "complex" else 2)
    for velocity, row in [(0, 0), (37, 211), (128, 5), (255, 299)]:
        per_chirp = 2 * np.pi * (velocity - N_CHIRPS) / over_velocity.n_bins
        per_sample = 2 * np.pi * row / over_range.n_bins
        phases = np.outer(m, per_chirp * sent_hz / sent_hz.mean()) + per_sample * n
        weights = np.outer(over_velocity.weights, over_range.weights)
        weights *= gain / weights.sum()
        right = np.einsum("mkn,mn->k", samples, weights * np.exp(-1j * phases))
        # Single precision: 1e-6 of the root of the noise in a cell.
        assert found[velocity, :, row] == pytest.approx(right, abs=1e-4 * float(abs(found).mean()))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity_m_per_s", [-25.0, 4.0, 11.0])
@pytest.mark.parametrize("pad", [1, 2])
def test_segments_leave_no_lobes_that_the_keystone_has_not(sampling, velocity_m_per_s, pad):
    of = radar(sampling)
    how = echo(of, velocity_m_per_s), sampling, *transforms("hann", pad)

    exact = abs(frame_transform("keystone", of.frame.chirp)(*how))
    steps = abs(frame_transform("segmented", of.frame.chirp)(*how))

    # A taper over w = 4 steps, turns of up to a quarter of a cycle in each: exp(-pi w sqrt(1/2)),
    # 78 dB, and once over for the alias on the other side. Segments side by side left 28 to 40.
    assert abs(steps - exact).max() < 2 * np.exp(-np.pi * 4 * np.sqrt(0.5)) * exact.max()


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("range_walk", ["keystone", "segmented"])
def test_a_strong_target_that_walks_is_one_detection(range_walk):
    of = radar()
    target = dc.Target(position_m=(6, 0, 0), velocity_m_per_s=(11, 0, 0), rcs_m2=10)
    cube = dc.simulate(dc.Scene(targets=[target]), of, seed=1)

    found = dc.detect(cube, of, dc.Chain(range_walk=range_walk))

    assert found.sizes["detection"] == 1
    assert found.snr.item() > 5e6  # 67 dB: segments side by side left thirteen lobes over it
    assert found.velocity.item() == pytest.approx(11, abs=0.01)


@pytest.mark.parametrize("name", ["keystone", "segmented"])
def test_noise_has_the_power_that_an_ordinary_transform_leaves(name):
    of = radar()
    rng = np.random.default_rng(5)
    samples = rng.standard_normal((2, N_CHIRPS, 2, N_SAMPLES)).astype(np.float32)
    noise = np.asarray(samples[0] + 1j * samples[1], np.complex64)
    over_range, over_velocity = transforms("rectangular", pad=1)
    how = noise, "complex", over_range, over_velocity
    plain = mean_power(*how).mean()

    kept = mean_power(*how, frame_transform(name, of.frame.chirp)).mean()

    # 76,800 independent cells; five standard deviations of their mean.
    assert kept / plain == pytest.approx(1, abs=5 / np.sqrt(2 * N_CHIRPS * N_SAMPLES))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("range_walk", [None, "keystone", "segmented"])
def test_estimates_of_a_walking_target_reach_the_bound(range_walk):
    of = radar()
    target = dc.Target(position_m=(6, 0, 0), velocity_m_per_s=(24, 0, 0), rcs_m2=1e-3)
    chain = dc.Chain(range_walk=range_walk)
    true = dc.truth(dc.Scene(targets=[target]), of)
    squared = {"range": [], "velocity": []}
    for seed in range(40):
        cube = dc.simulate(dc.Scene(targets=[target]), of, seed=seed)
        found = dc.detect(cube, of, chain)
        strongest = found.isel(detection=int(np.argmax(found.snr.values)))
        for name, errors in squared.items():
            error = float(strongest[name]) - float(true[name].squeeze())
            errors.append((error / float(strongest[f"{name}_std"])) ** 2)

    # Chi-squared of 40 degrees of freedom lies within 0.21 to 2.3 of its mean but for 1e-6.
    for errors in squared.values():
        assert 0.2 < np.mean(errors) < 2.3
