"""Each detector: alarms as designed, detections as its law says, and what sets it apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincc

import dechirp as dc
from dechirp.processing.cfar.base import MapNoise, NoiseEstimator, TrainingWindow
from dechirp.processing.cfar.member_comparison import compare_thresholds, make_example_map
from dechirp.processing.cfar.self_masking import self_masking_loss
from dechirp.processing.cfar.split_window import half_window_sizes
from dechirp.processing.chain_findings import chain_findings
from dechirp.processing.spectrum import Transform, mean_power
from dechirp.theory.cfar_detection import (
    cell_averaging_detection_probability,
    greatest_of_detection_probability,
    ordered_statistic_detection_probability,
    smallest_of_detection_probability,
)
from dechirp.theory.cfar_trimmed_mean import trimmed_mean_detection_probability
from dechirp.theory.confidence_intervals import binomial_interval
from nightly import nightly

MEMBERS = NoiseEstimator.members()
TRAINING, GUARD = dc.Cells(range=4, velocity=3), dc.Cells(range=2, velocity=2)


def noise_of(window, n_range, n_velocity, *, padded=1, n_channels=1):
    return MapNoise(
        range_transform=Transform(window=window, n_points=n_range, n_bins=padded * n_range),
        doppler_transform=Transform(window=window, n_points=n_velocity, n_bins=n_velocity),
        n_channels=n_channels,
    )


def noise_maps(noise, n_maps, seed):
    """Maps of white noise through the real transforms, of unit power in the mean."""
    rng = np.random.default_rng(seed)
    over_range, over_velocity = noise.range_transform, noise.doppler_transform
    gain = 1.0
    for transform in (over_range, over_velocity):
        gain *= transform.noise_bandwidth_bins / transform.n_points
    shape = (over_velocity.n_points, noise.n_channels, 2 * over_range.n_points)
    for _ in range(n_maps):
        samples = rng.standard_normal(shape, np.float32).view(np.complex64)
        yield mean_power(samples, "complex", over_range, over_velocity) / np.float32(2 * gain)


def cfar_of(kind, pfa, **cells):
    cells = {"n_training": TRAINING, "n_guard": GUARD, **cells}
    return dc.Cfar(estimator=MEMBERS[kind](), false_alarm_probability=pfa, **cells)


# Alarms come in clusters where bins are correlated: of 1.5 under Hann windows and 2.0 when padded
# along range as well, as the variance of counts over maps shows. 1,200 alarms are as uncertain as
# 600 independent ones: 4.1 %, five of which the band is wide.
@pytest.mark.parametrize(
    ("window", "padded", "n_channels"),
    [
        ("rectangular", 1, 1),
        ("hann", 1, 1),
        pytest.param("hann", 2, 1, marks=nightly),
        pytest.param("rectangular", 2, 4, marks=nightly),
    ],
)
def test_noise_alarms_as_often_as_designed(window, padded, n_channels):
    noise = noise_of(window, 1024, 128, padded=padded, n_channels=n_channels)
    # As wide as the main lobe, or the cell under test raises its threshold: allowed, but slow.
    guard = dc.Cells(range=2 * padded, velocity=2)
    cfars = {kind: cfar_of(kind, 1e-4, n_guard=guard) for kind in MEMBERS}
    counts, n_cells = dict.fromkeys(MEMBERS, 0), 0
    for power in noise_maps(noise, 92 // padded, seed=310):
        n_cells += power.size
        for kind, cfar in cfars.items():
            counts[kind] += int(cfar.exceeds_threshold(power, noise).sum())

    assert n_cells > 1.2e7
    for kind, count in counts.items():
        assert 0.8 < count / (1e-4 * n_cells) < 1.25, kind


# The cell under test is independent of its training cells, which are three bins off or more: given
# its threshold it alarms with a known probability, whose mean over maps is the rate.
@pytest.mark.parametrize(
    ("window", "n_channels"),
    [("rectangular", 1), ("hann", 1), pytest.param("hann", 4, marks=nightly)],
)
def test_noise_alarms_as_often_as_designed_in_every_row_of_the_range(window, n_channels):
    noise = noise_of(window, 24, 64, n_channels=n_channels)
    cfars, n_maps = {kind: cfar_of(kind, 1e-4) for kind in MEMBERS}, 500
    rates = {kind: np.empty((n_maps, 24)) for kind in MEMBERS}
    for i, power in enumerate(noise_maps(noise, n_maps, seed=311)):
        for kind, cfar in cfars.items():
            threshold = n_channels * cfar.threshold(power, noise).astype(float)
            rates[kind][i] = gammaincc(n_channels, threshold).mean(axis=0) / 1e-4
    for kind, rate in rates.items():
        error = rate.std(axis=0) / np.sqrt(n_maps)
        assert error.max() < 0.08
        assert np.all(abs(rate.mean(axis=0) - 1) < 5.5 * error + 0.02), kind
        # Six rows at either end, where the box is off its middle: 3 % standard error.
        for rows in (slice(6), slice(6, 18), slice(18, 24)):
            assert 0.8 < rate[:, rows].mean() < 1.25, kind


@pytest.mark.parametrize("kind", sorted(set(MEMBERS) - {"cell-averaging"}))
def test_the_calibrated_factor_of_the_default_window_holds_at_one_in_a_million(kind):
    noise = noise_of("hann", 1024, 128)
    ring = dc.Chain().cfar.training_window
    estimator = MEMBERS[kind]()
    factor = estimator.threshold_factor(1e-6, ring.noise_box(noise, ring.half_range), n_channels=1)
    assert 0 < factor.relative_error <= 0.01

    middle = slice(ring.half_range, -ring.half_range)
    factors = np.full(1024, factor.value, np.float32)
    rate, n_maps = 0.0, 12
    for power in noise_maps(noise, n_maps, seed=312):
        threshold = estimator.threshold(power, ring, factors).astype(float)
        rate += np.exp(-threshold[:, middle]).mean() / n_maps
    # 12 maps of some 300 rings side by side: the standard error of the mean is 1.8 to 3.2 %.
    assert rate == pytest.approx(1e-6, rel=0.18)


@pytest.mark.parametrize("kind", sorted(set(MEMBERS) - {"cell-averaging", "two-step"}))
def test_a_factor_is_found_where_little_leaks(kind):
    # In a short padded transform -27 dB at most leak, which turn the order of cells either way:
    # the factor may be larger or smaller than without.
    noise = noise_of("hann", 24, 32, padded=2)
    ring = TrainingWindow(
        n_training=dc.Cells(range=16, velocity=0), n_guard=dc.Cells(range=4, velocity=0)
    )
    box, estimator = ring.noise_box(noise, ring.half_range), MEMBERS[kind]()
    factors = [estimator.threshold_factor(pfa, box, n_channels=1) for pfa in (1e-2, 1e-4, 1e-6)]
    assert factors[0].value < factors[1].value < factors[2].value
    assert max(factor.relative_error for factor in factors) < 0.05

    # Drawn as they are: 2,000 alarms, 2.2 % standard error, and 1 % of the factor's own.
    n_draws, n_cells = 200_000, len(box.covariance)
    rng = np.random.default_rng(315)
    white = rng.standard_normal((n_draws, 2 * n_cells), np.float32).view(np.complex64)
    values, vectors = np.linalg.eigh(box.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    power = abs(white @ root.T.astype(np.complex64)) ** 2 / 2
    alarms = power[:, -1] > factors[0].value * estimator.statistic(power[:, :-1], box.offsets)
    assert np.mean(alarms) == pytest.approx(1e-2, rel=0.13)


def law(kind, offsets):
    """Probability of detecting a target of Swerling's case 1, from snr and factor."""
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


@pytest.mark.parametrize("place", [0, 3, 6])
@pytest.mark.parametrize("kind", MEMBERS)
def test_a_fluctuating_target_is_detected_as_often_as_the_law_says(kind, place):
    noise = noise_of("rectangular", 64, 64)
    ring = TrainingWindow(n_training=TRAINING, n_guard=GUARD)
    estimator, offsets = MEMBERS[kind](), ring.offsets(place)
    factor = estimator.threshold_factor(1e-4, ring.noise_box(noise, place), n_channels=1)
    assert factor.relative_error == 0
    rng, n_trials = np.random.default_rng(313), 40_000
    statistic = estimator.statistic(rng.exponential(size=(n_trials, len(offsets))), offsets)
    for snr in (3.0, 10.0, 100.0):
        target = (1 + snr) * rng.exponential(size=n_trials)
        hits = int(np.count_nonzero(target > factor.value * statistic))
        low, high = binomial_interval(hits, n_trials, confidence=1 - 1e-7)
        assert low < law(kind, offsets)(snr, factor.value) < high


# What sets them apart


def test_a_second_target_is_kept_by_some_and_masked_for_others():
    hits = dict.fromkeys(MEMBERS, 0)
    for seed in range(50):
        here = make_example_map(seed=seed)
        strong, weak = here.targets
        for kind, threshold in compare_thresholds(here.power, here.row).items():
            hits[kind] += here.power[here.row, weak] > threshold[weak]
            assert here.power[here.row, strong] > threshold[strong]
    # The strong target is 1,000 in one of 90 cells: it lifts their mean twelvefold, that of a
    # half twice as much, that of the line along range still more. Thresholds over the noise are
    # 12 dB, and 20 dB are there.
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


def at_a_step(kind, clutter, n_maps, seed):
    """Rate of false alarms in the first range cell of clutter, and of cells all in noise."""
    noise = noise_of("rectangular", 64, 32)
    rng = np.random.default_rng(seed)
    cfar = cfar_of(kind, 1e-3)
    first, calm = 0.0, 0.0
    for _ in range(n_maps):
        power = rng.exponential(size=(32, 64)).astype(np.float32)
        power[:, 32:] *= clutter
        threshold = cfar.threshold(power, noise).astype(float)
        first += np.exp(-threshold[:, 32] / clutter).mean() / n_maps
        calm += np.exp(-threshold[:, :20]).mean() / n_maps
    return first, calm


def test_at_the_edge_of_clutter_the_greatest_of_halves_keeps_its_rate():
    rates = {kind: at_a_step(kind, 100.0, 60, seed=314) for kind in MEMBERS}
    assert all(calm == pytest.approx(1e-3, rel=0.1) for _, calm in rates.values())
    # In the first row of clutter, the 56 cells before it are noise; the 56 beyond and the 6 beside
    # are clutter. Their mean, about half that of clutter, has the product of Gandhi and Kassam;
    # the greatest of halves is the mean of those beyond, the smallest of those before.
    ring = TrainingWindow(n_training=TRAINING, n_guard=GUARD)
    offsets = ring.offsets(ring.half_range)
    n_clutter = np.count_nonzero(offsets[:, 1] >= 0)
    a = MEMBERS["cell-averaging"]().independent_cells_factor(1e-3, offsets, n_channels=1) / len(
        offsets
    )
    expected = (1 + a) ** -n_clutter * (1 + a / 100) ** -(len(offsets) - n_clutter)
    first = {kind: rate for kind, (rate, _) in rates.items()}
    assert first["cell-averaging"] == pytest.approx(expected, rel=0.1)
    n = half_window_sizes(offsets)[1]
    t = MEMBERS["greatest-of"]().independent_cells_factor(1e-3, offsets, n_channels=1) / n
    assert first["greatest-of"] == pytest.approx((1 + t) ** -n, rel=0.2)
    assert 0.5e-3 < first["greatest-of"] < 3e-3
    assert first["cell-averaging"] > 20e-3
    assert first["smallest-of"] > 0.8


# What a user is told


def test_a_calibrated_factor_is_told_with_its_uncertainty(radar):
    cells = {"n_training": TRAINING, "n_guard": GUARD}
    for window, kind, told in (
        ("hann", "greatest-of", True),
        ("rectangular", "greatest-of", False),
        ("hann", "cell-averaging", False),
    ):
        cfar = cfar_of(kind, 1e-4, **cells)
        chain = dc.Chain(range_window=window, doppler_window=window, cfar=cfar)
        found = [f for f in chain_findings(radar, chain) if f.setting == "chain.cfar.estimator"]
        assert len(found) == told
        if told:
            error = cfar.false_alarm_error(chain.map_noise(radar))
            assert 0 < error <= 0.01
            assert f"{error:.1%} of the false-alarm probability" in found[0].value


def test_a_guard_inside_the_main_lobe_costs_what_the_target_lifts_its_own_mean():
    noise = noise_of("hann", 256, 128)
    cells = {"n_training": dc.Cells(range=8, velocity=0), "n_guard": dc.Cells(range=0, velocity=0)}
    loss = self_masking_loss(cfar_of("cell-averaging", 1e-4, **cells), noise)
    # The cell on each side has a quarter of the power: 0.5 in 16 cells.
    factor = 16 * (1e-4 ** (-1 / 16) - 1)
    assert loss == pytest.approx(1 / (1 - factor * 0.5 / 16), rel=1e-4)
    # Two of 16 cells that a target raises are above the rank.
    assert self_masking_loss(cfar_of("ordered-statistic", 1e-4, **cells), noise) == pytest.approx(1)
    # Over two cells on each side, a mean that a target raises by an eighth of itself, times 36.
    few = {**cells, "n_training": dc.Cells(range=2, velocity=0)}
    assert self_masking_loss(cfar_of("cell-averaging", 1e-4, **few), noise) == np.inf


@pytest.mark.parametrize(
    ("estimator", "needs"),
    [
        (lambda: dc.cfar.OrderedStatistic(rank=0), "above 0"),
        (lambda: dc.cfar.OrderedStatistic(rank=2.5), "a whole number of cells"),
        (lambda: dc.cfar.OrderedStatistic(rank=119), "at most 118"),
        (lambda: dc.cfar.TrimmedMean(n_largest=-1), "0 or more"),
        (lambda: dc.cfar.TrimmedMean(n_smallest=0.5, n_largest=0.5), "fewer than the 118"),
        (lambda: dc.cfar.TrimmedMean(n_largest=118), "fewer than the 118"),
    ],
)
def test_settings_that_cannot_work_are_refused(estimator, needs):
    with pytest.raises(dc.InvalidSetting, match=needs):
        dc.Cfar(
            estimator=estimator(),
            n_training=TRAINING,
            n_guard=GUARD,
            false_alarm_probability=1e-4,
        )


def test_two_steps_need_training_cells_along_both_axes():
    for axis in ("range", "velocity"):
        cells = {"n_training": replace(TRAINING, **{axis: 0})}
        with pytest.raises(dc.InvalidSetting, match=f"n_training.{axis} is 0.*two steps"):
            cfar_of("two-step", 1e-4, **cells)
