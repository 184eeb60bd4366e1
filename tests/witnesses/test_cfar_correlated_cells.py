"""Cell-averaging CFAR in correlated noise: factors against eigenvalues, a table and simulation."""

from dataclasses import replace

import numpy as np
import pytest
from mpmath import binomial, mp, mpf
from scipy.optimize import brentq

from dechirp.core.errors import InvalidSetting
from dechirp.processing.cfar.base import Cells, MapNoise, TrainingWindow
from dechirp.processing.spectrum import Transform
from dechirp.theory.cfar import cell_averaging_factor
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow, correlated_factor
from nightly import nightly


def compute_probability_by_eigenvalues(correlated_window, a, n_summed):
    """Compute the false-alarm probability of a factor a N from eigenvalues of the window."""
    covariance = np.kron(correlated_window.range_covariance, correlated_window.velocity_covariance)
    weights = np.full(
        (len(correlated_window.range_covariance), len(correlated_window.velocity_covariance)), -a
    )
    weights[correlated_window.guard_range, correlated_window.guard_velocity] = 0
    weights[correlated_window.cell_under_test] = 1
    used = np.flatnonzero(weights)
    # R A (covariance R, weights A) has the eigenvalues of B* A B with R = B B*.
    variances, eigenvectors = np.linalg.eigh(covariance[np.ix_(used, used)])
    root = eigenvectors * np.sqrt(np.clip(variances, 0, None))
    values = np.linalg.eigvalsh(root.conj().T @ (weights.ravel()[used, None] * root))
    top = values.max()
    mu = -values[values < top] / top
    sums = [n_summed * np.sum((mu / (1 + mu)) ** i) for i in range(n_summed)]
    terms = [np.exp(-n_summed * np.sum(np.log1p(mu)))]
    for j in range(1, n_summed):
        terms.append(sum(sums[i] * terms[j - i] for i in range(1, j + 1)) / j)
    return sum(terms)


CASES = [
    ("rectangular", 2200, "rectangular", 128),
    ("hann", 2200, "hann", 128),
    ("rectangular", 4096, "rectangular", 256),
    ("hann", 4096, "hann", 128),
    ("blackman", 2200, "hamming", 131),
]


@nightly
@pytest.mark.parametrize("n_summed", [1, 2, 8, 64])
@pytest.mark.parametrize("row", [0, 5, 14])
@pytest.mark.parametrize("case", CASES, ids=str)
def test_factor_gives_its_probability_by_eigenvalues_of_window(case, row, n_summed):
    window, n_bins, doppler_window, n_velocity_bins = case
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
        doppler_transform=Transform(window=doppler_window, n_points=128, n_bins=n_velocity_bins),
    )
    training_window = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    correlated_window = training_window.noise_covariance_in_box(noise, row)

    factor = correlated_factor(1e-6, correlated_window, n_summed=n_summed)

    probability = compute_probability_by_eigenvalues(
        correlated_window, factor / correlated_window.n_training, n_summed
    )
    # The matrix has 645 rows and is nearly singular when padded.
    assert probability == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("row", [0, 5, 14])
@pytest.mark.parametrize("case", CASES, ids=str)
def test_independent_cell_count_matches_variance_of_window_mean(case, row):
    window, n_bins, doppler_window, n_velocity_bins = case
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
        doppler_transform=Transform(window=doppler_window, n_points=128, n_bins=n_velocity_bins),
    )
    training_window = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    correlated_window = training_window.noise_covariance_in_box(noise, row)

    training_mask = np.ones(
        (len(correlated_window.range_covariance), len(correlated_window.velocity_covariance))
    )
    training_mask[correlated_window.guard_range, correlated_window.guard_velocity] = 0
    # |rho|^2 is the covariance of powers with a mean of 1.
    covariance = (
        abs(np.kron(correlated_window.range_covariance, correlated_window.velocity_covariance)) ** 2
    )
    variance = training_mask.ravel() @ covariance @ training_mask.ravel() / training_mask.sum() ** 2
    assert correlated_window.n_independent == pytest.approx(1 / variance, rel=1e-12)


def make_hann_window(n_range, n_velocity):
    """Make a training window for noise under Hann windows, without guard cells."""
    covariances = [
        Transform(window="hann", n_points=4096, n_bins=4096).noise_correlation_of_bins(n)
        for n in (n_range, n_velocity)
    ]
    centre = (n_range // 2, n_velocity // 2)
    guard = [slice(cell, cell + 1) for cell in centre]
    return CorrelatedWindow(
        range_covariance=covariances[0],
        velocity_covariance=covariances[1],
        guard_range=guard[0],
        guard_velocity=guard[1],
        cell_under_test=centre,
    )


@nightly
def test_hann_window_leaves_one_independent_cell_in_1_944_or_3_78():
    # 1 + 2 (4 / 9 + 1 / 36) along one axis; one cell in a thousand, at the ends and around the
    # cell under test, has fewer neighbours.
    for correlated_window in (make_hann_window(2000, 1), make_hann_window(1, 2000)):
        assert correlated_window.n_training / correlated_window.n_independent == pytest.approx(
            1.944, rel=2e-3
        )
    correlated_window = make_hann_window(600, 600)
    assert correlated_window.n_training / correlated_window.n_independent == pytest.approx(
        3.78, rel=2e-3
    )


def test_independent_cell_approximation_is_close_to_exact_factor():
    training_window = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    for window, n_bins, n_velocity_bins, tolerance in (
        ("hann", 2200, 128, 5e-4),
        ("hann", 4096, 128, 2e-3),
        ("rectangular", 4096, 256, 5e-3),
    ):
        noise = MapNoise(
            range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
            doppler_transform=Transform(window=window, n_points=128, n_bins=n_velocity_bins),
        )
        correlated_window = training_window.noise_covariance_in_box(noise, 14)
        n_training = round(correlated_window.n_independent)
        assert cell_averaging_factor(1e-6, n_training=n_training) == pytest.approx(
            correlated_factor(1e-6, correlated_window), rel=tolerance
        )


@pytest.mark.parametrize(
    ("name", "invalid_value"),
    [
        ("range_covariance", np.ones((29, 28))),
        ("velocity_covariance", np.ones(25)),
        ("guard_range", slice(-1, 20)),
        ("guard_range", slice(10, 30)),
        ("guard_range", slice(20, 10)),
        ("guard_velocity", slice(None, 17)),
        ("guard_velocity", slice(8, 17, 2)),
        ("cell_under_test", (9, 12)),
        ("cell_under_test", (14, 17)),
        ("cell_under_test", (14, 12.5)),
    ],
    ids=str,
)
def test_rejects_window_without_its_guard_or_cell_under_test(name, invalid_value):
    correlated_window = CorrelatedWindow(
        range_covariance=np.eye(29),
        velocity_covariance=np.eye(25),
        guard_range=slice(10, 19),
        guard_velocity=slice(8, 17),
        cell_under_test=(14, 12),
    )
    with pytest.raises(InvalidSetting, match=rf"^CorrelatedWindow\.{name}"):
        replace(correlated_window, **{name: invalid_value})


def test_reference_training_window_has_644_cells():
    training_window = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    noise = MapNoise(
        range_transform=Transform(window="rectangular", n_points=2200, n_bins=2200),
        doppler_transform=Transform(window="rectangular", n_points=128, n_bins=128),
    )
    assert training_window.noise_covariance_in_box(noise, 14).n_training == 644
    assert training_window.noise_covariance_in_box(noise, 14).n_independent == pytest.approx(
        644, rel=1e-12
    )
    assert cell_averaging_factor(1e-6, n_training=644) == pytest.approx(13.965, abs=5e-4)


def test_correlated_factor_reduces_to_independent_factor():
    training_window = TrainingWindow(
        n_training=Cells(range=3, velocity=2), n_guard=Cells(range=1, velocity=1)
    )
    noise = MapNoise(
        range_transform=Transform(window="rectangular", n_points=64, n_bins=64),
        doppler_transform=Transform(window="rectangular", n_points=32, n_bins=32),
    )
    correlated_window = training_window.noise_covariance_in_box(noise, 4)
    for n_summed in (1, 3):
        exact = cell_averaging_factor(
            1e-4, n_training=correlated_window.n_training, n_summed=n_summed
        )
        factor = correlated_factor(1e-4, correlated_window, n_summed=n_summed)
        assert factor == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("n_training", [1, 16, 644, 10_000])
@pytest.mark.parametrize("n_summed", [1, 2, 16])
@pytest.mark.parametrize("pfa", [1e-12, 1e-6, 0.5])
def test_independent_factor_holds_in_forty_digits(n_training, n_summed, pfa):
    factor = cell_averaging_factor(pfa, n_training=n_training, n_summed=n_summed)
    mp.dps = 40
    a, shape = mpf(factor) / n_training, n_training * n_summed
    probability = sum(
        binomial(shape + j - 1, j) * a**j / (1 + a) ** (shape + j) for j in range(n_summed)
    )
    assert float(probability) == pytest.approx(pfa, rel=1e-9)


def test_independent_factor_under_hann_window_raises_false_alarms_by_half():
    noise = MapNoise(
        range_transform=Transform(window="hann", n_points=2200, n_bins=2200),
        doppler_transform=Transform(window="hann", n_points=128, n_bins=128),
    )
    training_window = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    correlated_window = training_window.noise_covariance_in_box(noise, 14)
    independent_factor = cell_averaging_factor(1e-6, n_training=correlated_window.n_training)

    def excess(log_pfa):
        return correlated_factor(np.exp(log_pfa), correlated_window) - independent_factor

    # A separate simulation of 8.4e8 such cells measured 1.48e-6 with a standard error of 0.04e-6;
    # the tolerance is four of them.
    probability = np.exp(brentq(excess, np.log(1e-7), np.log(1e-5)))
    assert probability == pytest.approx(1.48e-6, abs=0.16e-6)
