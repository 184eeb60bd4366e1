"""Range and velocity estimates: Cramer-Rao bound, standard errors and bias."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.processing import refine
from dechirp.processing.detect import detect_columns
from dechirp.processing.refine import refine_tones
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.theory.bounds import frequency_variance, noncoherent_effective_snr
from nightly import NIGHTLY, nightly, nightly_except
from noise_cubes import add_noise, iter_noisy_trials


def estimate_errors(clean, radar, truth, snr_db, n_trials, seed):
    """Return errors, standard errors and SNRs of the strongest detection, (n_trials,) each."""
    names = ("range", "velocity", "range_std", "velocity_std", "snr")
    rows = []
    for cube in iter_noisy_trials(clean, snr_db, np.random.default_rng(seed), n_trials):
        detections = detect_columns([cube], radar)
        rows.append([detections[name][0] for name in names])
    range_m, velocity, *remaining_columns = np.array(rows).T
    return range_m - truth.range.item(0), velocity - truth.velocity.item(0), *remaining_columns


# 2,300 trials in nightly runs: the mean of squared normal errors over their variance has a standard
# error of 2.9 %, so that 0.85 to 1.15 is five of them; the root-mean-square has 1.5 %, the mean
# 2.1 % of the bound. 400 trials otherwise: 7.1 %, 3.5 % and 5 %.
N_TRIALS, SQUARE_TOLERANCE, MAX_RMSE = (2300, 0.15, 1.15) if NIGHTLY else (400, 0.36, 1.2)


@pytest.mark.parametrize("snr_db", nightly_except([-24], [-24, -10, 0]))
def test_reference_target_estimates_reach_crlb(reference, clean, snr_db):
    radar = reference.radar
    truth = dc.truth(reference.scene, radar)
    snr = 10 ** (snr_db / 10) * radar.integration_gain
    range_m, velocity, range_std, velocity_std, found_snr = estimate_errors(
        clean, radar, truth, snr_db, N_TRIALS, seed=31 - snr_db
    )

    for error, std, bound in zip(
        (range_m, velocity),
        (range_std, velocity_std),
        range_and_velocity_crlb_std(radar.frame, snr=snr),
        strict=True,
    ):
        assert np.sqrt(np.mean(error**2)) <= MAX_RMSE * bound
        assert abs(np.mean(error)) < 0.3 * bound
        assert np.mean(error**2 / std**2) == pytest.approx(1, abs=SQUARE_TOLERANCE)
    assert to_decibels(np.mean(found_snr)) == pytest.approx(to_decibels(snr), abs=0.3)


@nightly
@pytest.mark.parametrize("n_chirps", [2, 3, 4])
@pytest.mark.parametrize("velocity", [0.0, 3.0])
def test_few_chirps_reach_crlb(radar, n_chirps, velocity):
    radar = replace(radar, frame=replace(radar.frame, n_chirps=n_chirps))
    target = dc.Target(position_m=(30.0, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    clean, truth = dc.simulate(scene, radar, seed=1, impairments=[]), dc.truth(scene, radar)
    # 25 dB after integration, above the threshold of the maximum-likelihood estimate.
    snr_db = 25 - to_decibels(radar.integration_gain)

    range_m, velocity_m_per_s, range_std, velocity_std, _ = estimate_errors(
        clean, radar, truth, snr_db, 150, seed=n_chirps
    )

    # The mean of 150 squared normal errors over their variance has a standard error of 0.115.
    for error, std in ((range_m, range_std), (velocity_m_per_s, velocity_std)):
        assert np.mean(error**2 / std**2) == pytest.approx(1, abs=0.6)
    _, bound = range_and_velocity_crlb_std(radar.frame, snr=10**2.5)
    assert np.median(velocity_std) == pytest.approx(bound, rel=0.15)


@nightly
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_rx", [1, 4])
def test_estimates_reach_crlb_for_several_receivers_and_real_samples(radar, sampling, n_rx):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    frame = replace(radar.frame, chirp=chirp, n_chirps=64)
    array = dc.Array(rx_m=[(0, 0.0019 * k, 0) for k in range(n_rx)])
    radar = replace(radar, frame=frame, array=array)
    scene = dc.Scene(targets=[dc.Target(position_m=(13.37, 0, 0), velocity_m_per_s=(-7.3, 0, 0))])
    clean = dc.simulate(scene, radar, impairments=())
    truth = dc.truth(scene, radar)
    snr_db = -10
    snr = 10 ** (snr_db / 10) * radar.integration_gain
    range_m, velocity, range_std, velocity_std, found_snr = estimate_errors(
        clean, radar, truth, snr_db, 300, seed=41
    )
    # 300 trials have standard errors of 8.2 % for squares, 4.1 % for the root-mean-square and 5.8 %
    # of the bound for the mean; five of each are allowed.
    for error, std, bound in zip(
        (range_m, velocity),
        (range_std, velocity_std),
        range_and_velocity_crlb_std(radar.frame, snr=snr),
        strict=True,
    ):
        assert np.sqrt(np.mean(error**2)) == pytest.approx(bound, rel=0.21)
        assert abs(np.mean(error)) < 0.3 * bound
        assert np.mean(error**2 / std**2) == pytest.approx(1, abs=0.42)
    assert to_decibels(np.mean(found_snr)) == pytest.approx(to_decibels(snr), abs=0.3)


@nightly
@pytest.mark.parametrize("snr_db", [15, 20, 30])
@pytest.mark.parametrize("n_channels", [1, 4, 12])
def test_noncoherent_sum_reaches_variance_of_effective_snr(n_channels, snr_db):
    rng = np.random.default_rng(100 * n_channels + snr_db)
    n_chirps, n_samples, snr = 24, 20, 10 ** (snr_db / 10)
    m, n = np.arange(n_chirps)[:, None, None], np.arange(n_samples)
    phases = np.exp(2j * np.pi * rng.random((n_channels, 1)))
    amplitude = np.sqrt(snr / (n_channels * n_chirps * n_samples)) * phases
    squared = []
    for _ in range(2300):
        # The start is the peak of a map, up to a fifth of a bin off.
        slow, fast = np.array([0.7, 1.1]) + 2 * np.pi * rng.uniform(-0.2, 0.2, 2) / (24, 20)
        samples = amplitude * np.exp(1j * (slow * m + fast * n))
        noise = rng.standard_normal((2, *samples.shape)) / np.sqrt(2)
        samples = (samples + noise[0] + 1j * noise[1]).astype(np.complex64)
        tone = refine_tones(samples, np.array([0.7]), np.array([1.1]), np.ones(1))
        ratio = noncoherent_effective_snr(
            snr=tone.energy.item() - n_channels, n_channels=n_channels
        )
        squared.append(
            [
                (tone.slow.item() - slow) ** 2 / frequency_variance(snr=ratio, n_points=n_chirps),
                (tone.fast.item() - fast) ** 2 / frequency_variance(snr=ratio, n_points=n_samples),
            ]
        )

    # Both axes have 4,600 squared standard normal numbers: 2.1 %, five of which are 0.1. Higher
    # orders, 5 % of the variance at 15 dB, are negligible at 20 dB.
    assert 0.85 < np.mean(squared) < 1.15


@nightly
def test_standard_errors_of_weak_targets_on_twelve_channels_are_correct(radar):
    frame = replace(radar.frame, chirp=replace(radar.frame.chirp, n_samples=64), n_chirps=32)
    array = dc.Array(rx_m=[(0, 0.0019 * (k - 5.5), 0) for k in range(12)])
    radar = replace(radar, frame=frame, array=array)
    scene = dc.Scene(targets=[dc.Target(position_m=(9.37, 0, 0), velocity_m_per_s=(-7.3, 0, 0))])
    clean, truth = dc.simulate(scene, radar, impairments=()), dc.truth(scene, radar)
    snr_db, rng = 20 - to_decibels(radar.integration_gain), np.random.default_rng(43)
    chain = dc.Chain(
        angle=None, cfar=dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-3)
    )
    squared, n_lost, n_trials = [], 0, 1200
    for cube in iter_noisy_trials(clean, snr_db, rng, n_trials):
        detections = detect_columns([cube], radar, chain)
        errors = [detections[name] - truth[name].item() for name in ("range", "velocity")]
        is_near = abs(errors[0]) < frame.chirp.range_resolution_m
        is_near &= abs(errors[1]) < frame.velocity_resolution_m_per_s
        if not is_near.any():
            n_lost += 1  # the windows of the map reduce 20 dB to 16.4 dB
            continue
        index = int(np.flatnonzero(is_near)[0])
        std = detections["range_std"], detections["velocity_std"]
        squared.append(
            [
                float(error[index] / deviation[index]) ** 2
                for error, deviation in zip(errors, std, strict=True)
            ]
        )

    # Both axes have a standard error of 1 over the root of the trials: 2.9 % of 1,200. The channel
    # noise is 12 % of the variance; a start between bins once left 4 in 1,000 tones unrefined.
    assert n_lost < 12
    assert np.mean(squared) == pytest.approx(1, abs=5.2 / np.sqrt(n_trials))


@pytest.mark.parametrize("velocity", [-20.0, -3.0, 0.0, 11.0, 25.0])
@pytest.mark.parametrize("range_m", [3.3, 20.0, 61.7])
def test_range_and_velocity_are_exact_at_high_snr(radar, range_m, velocity):
    target = dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=1e4)], seed=1)
    truth = dc.truth(scene, radar)

    detection = dc.detect(cube, radar).isel(detection=0)

    # The bounds are 5 um and 8 um/s at 85 dB after integration, and half the path to the second
    # receiver differs by up to 0.03 mm. An approaching echo becomes stronger, so the range is
    # weighted towards the near end of its walk w in the frame, by w^2 / (6 R).
    walk_m = velocity * radar.frame.duration_s
    assert float(detection.range) == pytest.approx(
        float(truth.range[0, 0]), abs=6e-5 + 1.2 * walk_m**2 / (6 * range_m)
    )
    assert float(detection.velocity) == pytest.approx(float(truth.velocity[0, 0]), abs=5e-4)


def test_velocity_is_exact_where_coupling_aliases_beat_of_complex_samples(radar):
    velocity = 25.0
    # Half the coupling before the end of the range axis at mid-frame.
    chirp = radar.frame.chirp
    end_m = chirp.max_range_m - chirp.range_doppler_coupling_m(velocity) / 2
    target = dc.Target(
        position_m=(end_m - velocity * radar.frame.mid_frame_s, 0, 0),
        velocity_m_per_s=(velocity, 0, 0),
    )
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=1e4)], seed=1)
    truth = dc.truth(scene, radar)

    detection = dc.detect(cube, radar).isel(detection=0)

    # The tolerances are those of `test_range_and_velocity_are_exact_at_high_snr`. The wavelength of
    # the aliased beat, fs = 10 MHz lower, gives the velocity an error of v fs / f = 3.2 mm/s.
    assert float(detection.range) == pytest.approx(float(truth.range[0, 0]), abs=6e-5)
    assert float(detection.velocity) == pytest.approx(float(truth.velocity[0, 0]), abs=5e-4)


def test_sidelobes_of_strong_target_do_not_bias_weak_target(reference):
    radar = reference.radar
    cell = radar.frame.chirp.range_resolution_m
    weak_m = 50 + 16.5 * cell  # outside the training window of the truck
    targets = [
        dc.Target(name="truck", position_m=(50, 0, 0), rcs_m2=1000),
        dc.Target(name="bike", position_m=(weak_m, 0, 0), rcs_m2=1),
    ]
    scene = dc.Scene(targets=targets)
    clean = dc.simulate(scene, radar, impairments=())
    cube = add_noise(clean, 10, np.random.default_rng(51))

    detections = dc.detect(cube, radar)
    bike = detections.isel(detection=int(np.argmin(abs(detections.range.values - weak_m))))
    # The standard error without the truck is 7 mm at 34 dB. The truck's sidelobe in unwindowed
    # samples is 0.6 of the amplitude of the bike, a bias of a tenth of a cell.
    assert float(bike.range) == pytest.approx(weak_m, abs=5 * 0.0075)


def test_fast_strong_target_does_not_bias_target_80_db_weaker():
    """Include range walk: the sidelobes of a fast target walk with it."""
    n_chirps, n_samples, growth = 128, 256, 2.6e-5
    bins = 2 * np.pi / np.array([n_chirps, n_samples])
    slow = 0.5 - np.array([0, 9.6]) * bins[0]
    fast = 0.7 + np.array([0, 19.5]) * bins[1]
    m, n = np.arange(n_chirps)[:, None, None], np.arange(n_samples)
    samples = 0
    for amplitude, slow_rad, fast_rad in zip((1, 1e-4), slow, fast, strict=True):
        walk = growth * slow_rad * (m - (n_chirps - 1) / 2) * (n - (n_samples - 1) / 2)
        samples += amplitude * np.exp(1j * (slow_rad * m + fast_rad * n + walk))

    tones = refine_tones(
        samples.astype(np.complex64),
        slow + 0.2 * bins[0],
        fast - 0.2 * bins[1],
        np.full(2, 1e-12),
        growth=growth,
    )

    # The walk is 0.1 rad at the corners. The walk within a block of samples remains, some
    # hundredths of the sidelobe; the full walk biases the weak target by a quarter of a bin.
    error_bins = np.array([(tones.slow - slow)[1], (tones.fast - fast)[1]]) / bins
    assert abs(error_bins).max() < 0.03
    assert abs(tones.amplitude[1, 0]) == pytest.approx(1e-4, rel=0.02)


@pytest.mark.parametrize(
    "bins", [(None, None), (400, 65), pytest.param((777, 200), marks=nightly)], ids=str
)
@pytest.mark.parametrize("velocity", nightly_except([-27.0], [-27.0, -1.0, 27.0]))
def test_odd_numbers_of_chirps_samples_and_bins_cause_no_bias(radar, bins, velocity):
    chirp = replace(radar.frame.chirp, n_samples=255)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=63))
    scene = dc.Scene(
        targets=[dc.Target(position_m=(31.4, 0, 0), velocity_m_per_s=(velocity, 0, 0))]
    )
    cube = dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=100.0)], seed=1)
    truth = dc.truth(scene, radar)
    chain = dc.Chain(n_range_bins=bins[0], n_velocity_bins=bins[1])

    detection = dc.detect(cube, radar, chain).isel(detection=0)

    # Five standard errors of one trial at 65 dB after integration, and half the path to the second
    # receiver.
    range_error = float(detection.range) - float(truth.range[0, 0])
    assert abs(range_error) < 5 * float(detection.range_std) + 6e-5
    velocity_error = float(detection.velocity) - float(truth.velocity[0, 0])
    assert abs(velocity_error) < 5 * float(detection.velocity_std)


def test_delays_over_array_leave_amplitudes_of_weak_tone():
    """Delays that differ by 0.03 cells leave 0.015 / 48 of a tone 48 cells away in each channel."""
    n, bin_rad = np.arange(256), 2 * np.pi / 256
    channel_bins = 0.01 * np.array([-1.5, -0.5, 0.5, 1.5])
    strong_rad = (40.3 + channel_bins[:, None]) * bin_rad
    samples = np.exp(1j * strong_rad * (n - n.mean())) + 1e-3 * np.exp(1j * 88.3 * bin_rad * n)
    tones = refine_tones(
        np.repeat(samples[None], 64, axis=0).astype(np.complex64),
        np.zeros(2),
        np.array([40.3, 88.3]) * bin_rad,
        np.full(2, 1e-9),
    )

    # A frequency to first order in the offset, and an amplitude to second, have relative errors of
    # (0.015 pi)^2 / 6 = 4e-4: those of 0.3 of the weak tone, 1e-4; single precision adds 6e-5.
    np.testing.assert_allclose(tones.amplitude[1], 1e-3, rtol=5e-4)
    # The weak tone moves it by 1e-3 / 48 / 0.3 bins at most.
    assert tones.fast[0] / bin_rad == pytest.approx(40.3, abs=1e-4)


@pytest.mark.parametrize("n_turns", [-1, 1])
def test_walk_of_aliased_tone_leaves_weak_tone(n_turns):
    """A turn per chirp walks by growth M N = 0.66 cells more than the frequency shows."""
    m, n, growth = np.arange(128)[:, None] - 63.5, np.arange(256) - 127.5, 2e-5
    slow, fast = np.array([0.4, 0.4]), 2 * np.pi / 256 * np.array([40.3, 88.6])
    strong, weak = (
        np.exp(1j * (s * m + f * n + (s + 2 * np.pi * turns) * growth * m * n))
        for s, f, turns in zip(slow, fast, (n_turns, 0), strict=True)
    )
    tones = refine_tones(
        np.repeat((strong + 1e-2 * weak)[:, None], 2, axis=1).astype(np.complex64),
        slow,
        fast,
        np.full(2, 1e-5),
        growth=growth,
    )

    # The noise makes standard deviations of sqrt(6) / 2 pi / 810 = 5e-4 bins in the frequencies of
    # the weak tone, 58 dB after integration, and of 1.7e-3 in its amplitudes: once and twice those.
    bins = np.array([128, 256]) / (2 * np.pi)
    errors = abs(np.array([tones.slow - slow, tones.fast - fast]))[:, 1] * bins
    assert np.all(errors < 5e-4), errors
    np.testing.assert_allclose(abs(tones.amplitude[1]), 1e-2, rtol=3.4e-3)


@pytest.mark.parametrize(("n_cells", "tolerance"), [(1, 2e-5), (8, 2e-4), (20, 1e-3)])
def test_walk_of_tone_leaves_its_amplitude(n_cells, tolerance):
    """Uncompensated, a walk of 20 cells takes a third of the amplitude of sums over blocks."""
    m, n, slow = np.arange(128)[:, None, None] - 63.5, np.arange(256) - 127.5, 0.4
    growth = 2 * np.pi * n_cells / (128 * 256 * slow)
    tone = np.exp(1j * (slow * m + 0.7 * n + growth * slow * m * n))

    tones = refine_tones(
        tone.astype(np.complex64),
        np.array([slow]),
        np.array([0.7]),
        np.full(1, 1e-6),
        growth=growth,
    )

    # p q turns the corners of blocks by 0.006 rad a cell: 0.0008 of the amplitude for 20.
    assert abs(tones.amplitude[0, 0]) == pytest.approx(1, rel=tolerance)


@pytest.mark.parametrize("n_cells", [4, 20])
def test_walk_of_tone_leaves_its_frequencies_at_their_bound(n_cells):
    m, n, slow, fast = np.arange(128)[:, None, None] - 63.5, np.arange(256) - 127.5, 0.4, 0.7
    growth, n_trials = 2 * np.pi * n_cells / (128 * 256 * slow), 150
    tone = np.exp(1j * (slow * m + fast * n + growth * slow * m * n))
    rng, noise_power = np.random.default_rng(n_cells), 32.0  # 30 dB after integration
    errors = np.empty((n_trials, 2))
    for trial in range(n_trials):
        noise = rng.normal(size=(2, *tone.shape)) * np.sqrt(noise_power / 2)
        tones = refine_tones(
            (tone + noise[0] + 1j * noise[1]).astype(np.complex64),
            np.array([slow]),
            np.array([fast]),
            np.full(1, noise_power),
            growth=growth,
        )
        errors[trial] = tones.slow.item() - slow, tones.fast.item() - fast

    # The walk is that of the estimated slow-time frequency: its error walks as well, which changes
    # nothing at mid-frame. Uncompensated in blocks, 3 times the variance at 20 cells.
    bounds = [frequency_variance(snr=1024.0, n_points=n_points) for n_points in (128, 256)]
    squares = np.sum(errors**2 / bounds, axis=0)
    assert np.all(squares > chi2.ppf(1e-7, n_trials)), squares
    assert np.all(squares < chi2.ppf(1 - 1e-7, n_trials)), squares


@pytest.mark.parametrize("apart_bins", [16.2, 20.3, 31.8, 48.4])
@pytest.mark.parametrize(("n_turns", "ratio_db"), [(0, 70), (-1, 50)])
def test_strong_tone_that_walks_and_grows_leaves_weak_tone(n_turns, ratio_db, apart_bins):
    """A target at 25 m that approaches at 20 m/s, or 75 m/s: it grows by 0.7 or 2.7 %."""
    m, n = np.arange(128)[:, None] - 63.5, np.arange(256) - 127.5
    growth, interval_ratio = 2.6e-5, 1 / 350
    bins = np.array([128, 256]) / (2 * np.pi)
    slow = np.array([-46.1, -46.15]) / bins[0]
    fast = (84.6 + np.array([0.0, apart_bins])) / bins[1]
    true_slow = slow + 2 * np.pi * np.array([n_turns, 0])
    strong, weak = (
        np.exp(1j * (s * m + f * n + growth * w * (m + interval_ratio * n) * n))
        for s, f, w in zip(slow, fast, true_slow, strict=True)
    )
    strong = strong * (1 - 0.0036 * true_slow[0] / slow[0] * m / 64)
    weak_amplitude = 10 ** (-ratio_db / 20)
    tones = refine_tones(
        np.repeat((strong + weak_amplitude * weak)[:, None], 2, axis=1).astype(np.complex64),
        slow,
        fast,
        np.full(2, 1e-3 * weak_amplitude**2),
        growth=growth,
        interval_ratio=interval_ratio,
    )

    # A third of the standard deviation sqrt(6) / 2 pi / 40 bins of a tone of 32 dB, whose squared
    # error then is 1.1 of the variance.
    errors = abs(np.array([tones.slow - slow, tones.fast - fast]))[:, 1] * bins
    assert np.all(errors < 0.0033), errors


@nightly
@pytest.mark.parametrize(
    ("ratio_db", "apart_cells"),
    [(70, 48), (50, 24), (60, 24), (60, 32), (60, 80), (70, 24), (70, 80)],
)
@pytest.mark.parametrize("is_triangular", [False, True])
def test_errors_beside_strong_fast_echo_match_stated_ones(
    radar, ratio_db, apart_cells, is_triangular
):
    """A strong echo moves by almost half a cell within the frame, at 26 m/s."""
    cell, velocity, n_trials = radar.frame.chirp.range_resolution_m, 26.5, 40
    if is_triangular:  # of twice the length
        frame = replace(radar.frame, modulation=dc.modulations.Triangular())
        radar, velocity = replace(radar, frame=frame), velocity / 2
    squares, n_of_white_noise = np.empty((n_trials, 2)), 0
    rng = np.random.default_rng([ratio_db, apart_cells])
    for trial in range(n_trials):
        ranges_m = 25 + cell * (rng.random() + np.array([0, apart_cells + rng.uniform(-0.5, 0.5)]))
        strong, weak = (
            dc.Target(
                position_m=(range_m - velocity * radar.frame.mid_frame_s, 0, 0),
                velocity_m_per_s=(velocity, 0, 0),
                rcs_m2=rcs_m2,
            )
            for range_m, rcs_m2 in zip(
                ranges_m, (10 ** (ratio_db / 10) * (ranges_m[0] / ranges_m[1]) ** 4, 1), strict=True
            )
        )
        scene = dc.Scene(targets=[strong, weak])
        clean = dc.simulate(scene, radar, impairments=())
        cube = add_noise(clean, 30 + ratio_db - 48, rng)  # 48 dB by integration: 30 of the weak one
        truth = dc.truth(scene, radar).isel(frame=0, target=1)

        detections = dc.detect(cube, radar)
        near_strong, near_weak = (
            detections.isel(detection=int(np.argmin(abs(detections.range.values - range_m))))
            for range_m in ranges_m
        )
        squares[trial] = [
            ((near_weak[name] - truth[name]) / near_weak[f"{name}_std"]).item() ** 2
            for name in ("range", "velocity")
        ]
        bounds = range_and_velocity_crlb_std(radar.frame, snr=near_strong.snr.item())
        stds = near_strong.range_std.item(), near_strong.velocity_std.item()
        n_of_white_noise += stds == pytest.approx(bounds, rel=0.02)

    # Motion and growth of the strong echo are no echo beside it. Noise is taken for one with 0.001
    # on each axis of each map: in more than 5 of 40 trials by chance less often than once in 10^6.
    assert n_of_white_noise >= 35
    # Measured in 60 trials each: 0.7 to 1.6. Without growth of the strong echo, its walk within
    # chirps, and second orders of that within blocks of samples: up to 25.
    assert np.all(squares.mean(axis=0) > chi2.ppf(1e-7, n_trials) / n_trials)
    assert np.all(squares.mean(axis=0) < chi2.ppf(1 - 1e-7, n_trials) / n_trials)


def test_walk_of_a_fraction_of_a_turn_is_not_taken_for_aliasing(monkeypatch):
    m, n, growth = np.arange(128)[:, None] - 63.5, np.arange(256) - 127.5, 2e-5
    echo = np.exp(1j * (0.4 * m + n + (0.4 + 2 * np.pi * 0.7) * growth * m * n))
    tone = np.array([0.4]), np.array([1.0]), np.array([1e-5])

    tones = refine_tones(echo[:, None].astype(np.complex64), *tone, growth=growth)

    monkeypatch.setattr(refine, "_MAX_WALK_PASSES", 0)
    without = refine_tones(echo[:, None].astype(np.complex64), *tone, growth=growth)
    np.testing.assert_allclose(tones.amplitude, without.amplitude, rtol=1e-9)
    assert abs(without.amplitude.item()) < 0.98  # smeared: the walk was significant


def test_walk_of_several_echoes_in_a_few_cells_is_not_taken_for_aliasing(monkeypatch):
    """Their walk is a whole turn by chance: their peak has their power beside it."""
    m, n, growth = np.arange(128)[:, None] - 63.5, np.arange(256) - 127.5, 2e-5
    bin_rad = 2 * np.pi / np.array([128, 256])
    echo = np.exp(1j * (0.4 + 2 * np.pi) * growth * m * n)
    echo += 0.3 * np.exp(1j * (3 * bin_rad[0] * m + 1.3 * bin_rad[1] * n))
    samples = (echo * np.exp(1j * (0.4 * m + n)))[:, None].astype(np.complex64)
    tone = np.array([0.4]), np.array([1.0]), np.array([1e-5])

    tones = refine_tones(samples, *tone, growth=growth)

    monkeypatch.setattr(refine, "_MAX_WALK_PASSES", 0)
    without = refine_tones(samples, *tone, growth=growth)
    np.testing.assert_allclose(tones.amplitude, without.amplitude, rtol=1e-9)
