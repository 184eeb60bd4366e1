"""CFAR members: false-alarm rate, detection probability, masking and clutter edges."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincc

import dechirp as dc
from dechirp.processing.cfar.base import MapNoise, NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.member_comparison import compare_thresholds, make_example_map
from dechirp.processing.cfar.split_window import half_window_sizes
from dechirp.processing.chain_findings import chain_findings, self_masking_loss
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.theory.cfar_detection import (
    cell_averaging_detection_probability,
    greatest_of_detection_probability,
    ordered_statistic_detection_probability,
    smallest_of_detection_probability,
)
from dechirp.theory.cfar_trimmed_mean import trimmed_mean_detection_probability
from dechirp.theory.confidence_intervals import binomial_interval
from nightly import nightly, nightly_except

MEMBERS = NoiseEstimator.members()
TRAINING_CELLS, GUARD_CELLS = dc.Cells(range=4, velocity=3), dc.Cells(range=2, velocity=2)


def make_map_noise(window, n_range, n_velocity, *, padding_factor=1, n_channels=1):
    return MapNoise(
        range_transform=Transform(window=window, n_points=n_range, n_bins=padding_factor * n_range),
        doppler_transform=Transform(window=window, n_points=n_velocity, n_bins=n_velocity),
        n_channels=n_channels,
    )


def draw_noise_maps(noise, n_maps, seed):
    """Yield maps of white noise of unit mean power, computed with the real transforms."""
    rng = np.random.default_rng(seed)
    range_transform, doppler_transform = noise.range_transform, noise.doppler_transform
    gain = 1.0
    for transform in (range_transform, doppler_transform):
        gain *= transform.noise_bandwidth_bins / transform.n_points
    shape = (doppler_transform.n_points, noise.n_channels, 2 * range_transform.n_points)
    for _ in range(n_maps):
        samples = rng.standard_normal(shape, np.float32).view(np.complex64)
        yield mean_range_doppler_power(
            samples, "complex", range_transform, doppler_transform
        ) / np.float32(2 * gain)


def make_cfar(kind, pfa, **cells):
    cells = {"n_training": TRAINING_CELLS, "n_guard": GUARD_CELLS, **cells}
    return dc.Cfar(estimator=MEMBERS[kind](), false_alarm_probability=pfa, **cells)


# Alarms are clustered where bins are correlated: 1.5 per cluster with Hann windows and 2.0 with
# range padding too, as the variance of counts over maps shows. 1,200 alarms are as uncertain as 600
# independent ones: 4.1 %, five of which are allowed.
@pytest.mark.parametrize(
    ("window", "padding_factor", "n_channels"),
    [
        ("rectangular", 1, 1),
        # By default the next test covers Hann windows: calibrations for this one take seconds.
        pytest.param("hann", 1, 1, marks=nightly),
        pytest.param("hann", 2, 1, marks=nightly),
        pytest.param("rectangular", 2, 4, marks=nightly),
    ],
)
def test_false_alarm_rate_matches_setting(window, padding_factor, n_channels):
    noise = make_map_noise(window, 1024, 128, padding_factor=padding_factor, n_channels=n_channels)
    # The guard window covers the main lobe; a smaller one is allowed, but the cell under test
    # raises its own threshold.
    guard = dc.Cells(range=2 * padding_factor, velocity=2)
    cfars = {kind: make_cfar(kind, 1e-4, n_guard=guard) for kind in MEMBERS}
    counts, n_cells = dict.fromkeys(MEMBERS, 0), 0
    for power in draw_noise_maps(noise, 92 // padding_factor, seed=310):
        n_cells += power.size
        for kind, cfar in cfars.items():
            counts[kind] += int(cfar.exceeds_threshold(power, noise).sum())

    assert n_cells > 1.2e7
    for kind, count in counts.items():
        assert 0.8 < count / (1e-4 * n_cells) < 1.25, kind


# The cell under test is independent of its training cells, which are at least three bins away: its
# alarm probability follows from its threshold, and the mean over maps is the rate.
@nightly
@pytest.mark.parametrize(
    ("window", "n_channels"),
    [("rectangular", 1), ("hann", 1), ("hann", 4)],
)
def test_false_alarm_rate_matches_setting_in_every_range_row(window, n_channels):
    noise = make_map_noise(window, 24, 64, n_channels=n_channels)
    cfars, n_maps = {kind: make_cfar(kind, 1e-4) for kind in MEMBERS}, 500
    rates = {kind: np.empty((n_maps, 24)) for kind in MEMBERS}
    for i, power in enumerate(draw_noise_maps(noise, n_maps, seed=311)):
        for kind, cfar in cfars.items():
            threshold = n_channels * cfar.threshold(power, noise).astype(float)
            rates[kind][i] = gammaincc(n_channels, threshold).mean(axis=0) / 1e-4
    for kind, rate in rates.items():
        error = rate.std(axis=0) / np.sqrt(n_maps)
        assert error.max() < 0.08
        assert np.all(abs(rate.mean(axis=0) - 1) < 5.5 * error + 0.02), kind
        # Six rows at either end, where the window is shifted: 3 % standard error.
        for rows in (slice(6), slice(6, 18), slice(18, 24)):
            assert 0.8 < rate[:, rows].mean() < 1.25, kind


@nightly
@pytest.mark.parametrize("kind", sorted(set(MEMBERS) - {"cell-averaging"}))
def test_calibrated_factor_of_default_window_yields_rate_of_1e_6(kind):
    noise = make_map_noise("hann", 1024, 128)
    training_window = dc.Chain().cfar.training_window
    estimator = MEMBERS[kind]()
    factor = estimator.threshold_factor(
        1e-6,
        training_window.noise_covariance_in_box(noise, training_window.half_range),
        n_channels=1,
    )
    assert 0 < factor.relative_error <= 0.01

    full_rows = slice(training_window.half_range, -training_window.half_range)
    factors = np.full(1024, factor.value, np.float32)
    rate, n_maps = 0.0, 12
    for power in draw_noise_maps(noise, n_maps, seed=312):
        threshold = estimator.threshold(power, training_window, factors).astype(float)
        rate += np.exp(-threshold[:, full_rows]).mean() / n_maps
    # 12 maps with some 300 separate training windows: standard error of the mean 1.8 to 3.2 %.
    assert rate == pytest.approx(1e-6, rel=0.18)


@nightly
@pytest.mark.parametrize("kind", sorted(set(MEMBERS) - {"cell-averaging", "two-step"}))
def test_calibrated_factor_is_correct_for_short_padded_transforms(kind):
    # Leakage in a short padded transform is at most -27 dB and exchanges ranks of cells either way:
    # the factor may be larger or smaller than without.
    noise = make_map_noise("hann", 24, 32, padding_factor=2)
    training_window = TrainingWindow(
        n_training=dc.Cells(range=16, velocity=0), n_guard=dc.Cells(range=4, velocity=0)
    )
    box, estimator = (
        training_window.noise_covariance_in_box(noise, training_window.half_range),
        MEMBERS[kind](),
    )
    factors = [estimator.threshold_factor(pfa, box, n_channels=1) for pfa in (1e-2, 1e-4, 1e-6)]
    assert factors[0].value < factors[1].value < factors[2].value
    assert max(factor.relative_error for factor in factors) < 0.05

    # 2,000 alarms have a standard error of 2.2 %, and the factor 1 %.
    n_draws, n_cells = 200_000, len(box.covariance)
    rng = np.random.default_rng(315)
    white = rng.standard_normal((n_draws, 2 * n_cells), np.float32).view(np.complex64)
    values, vectors = np.linalg.eigh(box.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    power = abs(white @ root.T.astype(np.complex64)) ** 2 / 2
    alarms = power[:, -1] > factors[0].value * estimator.statistic(
        power[:, :-1], box.training_offsets
    )
    assert np.mean(alarms) == pytest.approx(1e-2, rel=0.13)


def detection_law(kind, offsets):
    """Return the detection probability of a Swerling 1 target as a function of SNR and factor."""
    n = len(offsets)
    lines = tuple(int(np.count_nonzero(offsets[:, axis] == 0)) for axis in (0, 1))
    if kind == "trimmed-mean":
        cells = {"n_training": n, "n_smallest": 0, "n_largest": int(np.ceil(n / 4))}
        return lambda snr, factor: trimmed_mean_detection_probability(snr, factor, **cells)
    detection, cells = {
        "cell-averaging": (cell_averaging_detection_probability, {"n_training": n}),
        "greatest-of": (
            greatest_of_detection_probability,
            {"n_training": half_window_sizes(offsets)},
        ),
        "smallest-of": (
            smallest_of_detection_probability,
            {"n_training": half_window_sizes(offsets)},
        ),
        "ordered-statistic": (
            ordered_statistic_detection_probability,
            {"n_training": n, "rank": int(np.ceil(0.75 * n))},
        ),
        "two-step": (greatest_of_detection_probability, {"n_training": lines}),
    }[kind]
    return lambda snr, factor: detection(snr, factor, swerling=1, **cells)


@pytest.mark.parametrize("row", [0, 3, 6])
@pytest.mark.parametrize("kind", nightly_except(1, MEMBERS))
def test_detection_probability_of_swerling_1_target_matches_theory(kind, row):
    noise = make_map_noise("rectangular", 64, 64)
    training_window = TrainingWindow(n_training=TRAINING_CELLS, n_guard=GUARD_CELLS)
    estimator, offsets = MEMBERS[kind](), training_window.training_cell_offsets(row)
    factor = estimator.threshold_factor(
        1e-4, training_window.noise_covariance_in_box(noise, row), n_channels=1
    )
    assert factor.relative_error == 0
    rng, n_trials = np.random.default_rng(313), 40_000
    statistic = estimator.statistic(rng.exponential(size=(n_trials, len(offsets))), offsets)
    for snr in (3.0, 10.0, 100.0):
        target = (1 + snr) * rng.exponential(size=n_trials)
        hits = int(np.count_nonzero(target > factor.value * statistic))
        low, high = binomial_interval(hits, n_trials, confidence=1 - 1e-7)
        assert low < detection_law(kind, offsets)(snr, factor.value) < high


# Differences between members


@nightly
def test_second_target_is_masked_by_mean_based_detectors_only():
    hits = dict.fromkeys(MEMBERS, 0)
    for seed in range(50):
        example = make_example_map(seed=seed)
        strong_index, weak_index = example.targets
        for kind, threshold in compare_thresholds(example.power, example.row).items():
            hits[kind] += example.power[example.row, weak_index] > threshold[weak_index]
            assert example.power[example.row, strong_index] > threshold[strong_index]
    # The strong target is 1,000 in one of 90 cells: it raises their mean twelvefold, that of a half
    # window twice as much, that of the range line still more. Thresholds are 12 dB above the noise,
    # and the weak target is at 20 dB.
    assert {kind for kind, count in hits.items() if count == 0} == {
        "cell-averaging",
        "greatest-of",
        "two-step",
    }
    assert {kind for kind, count in hits.items() if count == 50} == {
        "ordered-statistic",
        "trimmed-mean",
        "smallest-of",
    }


def measure_clutter_edge_rates(kind, clutter, n_maps, seed):
    """Return the false-alarm rates in the first range cell of clutter and in noise-only cells."""
    noise = make_map_noise("rectangular", 64, 32)
    rng = np.random.default_rng(seed)
    cfar = make_cfar(kind, 1e-3)
    edge_rate, noise_rate = 0.0, 0.0
    for _ in range(n_maps):
        power = rng.exponential(size=(32, 64)).astype(np.float32)
        power[:, 32:] *= clutter
        threshold = cfar.threshold(power, noise).astype(float)
        edge_rate += np.exp(-threshold[:, 32] / clutter).mean() / n_maps
        noise_rate += np.exp(-threshold[:, :20]).mean() / n_maps
    return edge_rate, noise_rate


@nightly
def test_greatest_of_keeps_false_alarm_rate_at_clutter_edge():
    rates = {kind: measure_clutter_edge_rates(kind, 100.0, 60, seed=314) for kind in MEMBERS}
    assert all(noise_rate == pytest.approx(1e-3, rel=0.1) for _, noise_rate in rates.values())
    # At the first row of clutter, the 56 preceding cells are noise; the 56 following and the 6
    # beside are clutter. Their mean, about half the clutter power, has the product law of Gandhi
    # and Kassam; greatest-of takes the mean of the following cells, smallest-of that of the
    # preceding ones.
    training_window = TrainingWindow(n_training=TRAINING_CELLS, n_guard=GUARD_CELLS)
    offsets = training_window.training_cell_offsets(training_window.half_range)
    n_clutter = np.count_nonzero(offsets[:, 1] >= 0)
    a = MEMBERS["cell-averaging"]().independent_cells_threshold_factor(
        1e-3, offsets, n_channels=1
    ) / len(offsets)
    expected = (1 + a) ** -n_clutter * (1 + a / 100) ** -(len(offsets) - n_clutter)
    edge_rates = {kind: rate for kind, (rate, _) in rates.items()}
    assert edge_rates["cell-averaging"] == pytest.approx(expected, rel=0.1)
    n = half_window_sizes(offsets)[1]
    t = MEMBERS["greatest-of"]().independent_cells_threshold_factor(1e-3, offsets, n_channels=1) / n
    assert edge_rates["greatest-of"] == pytest.approx((1 + t) ** -n, rel=0.2)
    assert 0.5e-3 < edge_rates["greatest-of"] < 3e-3
    assert edge_rates["cell-averaging"] > 20e-3
    assert edge_rates["smallest-of"] > 0.8


# Findings


@nightly
def test_finding_reports_uncertainty_of_calibrated_factor(radar):
    cells = {"n_training": TRAINING_CELLS, "n_guard": GUARD_CELLS}
    for window, kind, is_reported in (
        ("hann", "greatest-of", True),
        ("rectangular", "greatest-of", False),
        ("hann", "cell-averaging", False),
    ):
        cfar = make_cfar(kind, 1e-4, **cells)
        chain = dc.Chain(range_window=window, doppler_window=window, cfar=cfar)
        findings = [f for f in chain_findings(radar, chain) if f.setting == "chain.cfar.estimator"]
        assert len(findings) == is_reported
        if is_reported:
            error = cfar.false_alarm_probability_error(chain.map_noise_statistics(radar))
            assert 0 < error <= 0.01
            assert f"{error:.1%} of the false-alarm probability" in findings[0].value


def test_self_masking_loss_equals_rise_of_training_mean():
    noise = make_map_noise("hann", 256, 128)
    cells = {"n_training": dc.Cells(range=8, velocity=0), "n_guard": dc.Cells(range=0, velocity=0)}
    loss = self_masking_loss(make_cfar("cell-averaging", 1e-4, **cells), noise)
    # The cell on each side has a quarter of the power: 0.5 in 16 cells.
    factor = 16 * (1e-4 ** (-1 / 16) - 1)
    assert loss == pytest.approx(1 / (1 - factor * 0.5 / 16), rel=1e-4)
    # The target raises two of 16 cells, which are above the rank.
    assert self_masking_loss(make_cfar("ordered-statistic", 1e-4, **cells), noise) == pytest.approx(
        1
    )
    # Two cells on each side: the target raises their mean by an eighth of itself, times 36.
    small_window = {**cells, "n_training": dc.Cells(range=2, velocity=0)}
    assert self_masking_loss(make_cfar("cell-averaging", 1e-4, **small_window), noise) == np.inf


@pytest.mark.parametrize(
    ("estimator", "expected"),
    [
        (lambda: dc.cfar.OrderedStatistic(rank=0), "above 0"),
        (lambda: dc.cfar.OrderedStatistic(rank=2.5), "a whole number of cells"),
        (lambda: dc.cfar.OrderedStatistic(rank=119), "at most 118"),
        (lambda: dc.cfar.TrimmedMean(n_largest=-1), "0 or more"),
        (lambda: dc.cfar.TrimmedMean(n_smallest=0.5, n_largest=0.5), "fewer than the 118"),
        (lambda: dc.cfar.TrimmedMean(n_largest=118), "fewer than the 118"),
    ],
)
def test_rejects_invalid_settings(estimator, expected):
    with pytest.raises(dc.InvalidSetting, match=expected):
        dc.Cfar(
            estimator=estimator(),
            n_training=TRAINING_CELLS,
            n_guard=GUARD_CELLS,
            false_alarm_probability=1e-4,
        )


def test_two_step_needs_training_cells_along_both_axes():
    for axis in ("range", "velocity"):
        cells = {"n_training": replace(TRAINING_CELLS, **{axis: 0})}
        with pytest.raises(dc.InvalidSetting, match=f"n_training.{axis}: 0.*two steps"):
            make_cfar("two-step", 1e-4, **cells)
