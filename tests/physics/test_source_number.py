"""How many sources are there: by MDL and AIC, in one look and in many."""

import numpy as np
import pytest

from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.covariance import Smoothing, array_windows
from dechirp.processing.angle.esprit import Esprit
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.angle.model_order import estimate_n_sources
from dechirp.processing.angle.music import Music
from dechirp.processing.angle.root_music import RootMusic
from looks import HALF_POWER, line, pair, snapshots, turns

N = 2000
NOISE = 0.01


def sources(array, count, n, rng, n_looks=1, noise=NOISE):
    """One source, or two a beamwidth apart, of any phase."""
    length = np.ptp(array.positions[:, 1]) + 0.5
    azimuth = pair(array, HALF_POWER / length, n, rng)[:, :count]
    return snapshots(array, turns((n, count, n_looks), rng), noise, rng, azimuth)


@pytest.mark.parametrize("criterion", ["mdl", "aic"])
@pytest.mark.parametrize("n_elements", [8, 12])
@pytest.mark.parametrize("count", [1, 2])
def test_the_windows_of_one_look_show_how_many_sources_there_are(count, n_elements, criterion):
    array = line(n_elements)
    x = sources(array, count, N, np.random.default_rng(721), noise=NOISE)
    found = estimate_n_sources(x, array, np.full(N, NOISE), criterion)
    # Noise alone passes the price with less than one in a hundred.
    assert np.mean(found == count) > 0.98


def test_three_sources_are_counted_in_looks_that_do_not_fade_together():
    # Uneven: one window. Classic: as many looks as there are, Wax and Kailath's own case.
    array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1, 4.4, 5])[:, None] * [0, 1, 0])
    rng = np.random.default_rng(722)
    azimuth = np.tile([-0.5, 0.0, 0.4], (N, 1))
    x = snapshots(array, rng.normal(size=(N, 3, 50, 2)) @ [1, 1j], 0.1, rng, azimuth)
    assert np.mean(estimate_n_sources(x, array, np.full(N, 0.1), "mdl") == 3) > 0.99
    assert np.mean(estimate_n_sources(x, array, np.full(N, 0.1), "aic") == 3) > 0.95


def test_noise_in_overlapping_windows_is_worth_the_snapshots_that_are_told():
    # The mean power over all windows has the variance of as many independent numbers.
    array, rng = line(12), np.random.default_rng(723)
    over = array_windows(array, Smoothing())
    x = snapshots(array, np.zeros((20_000, 1, 1)), 1.0, rng, np.zeros((20_000, 1)))
    power = np.mean(np.abs(over.window_data(x)) ** 2, axis=(1, 2))
    # A variance of 20,000 powers has a spread of 1.2 %.
    assert 1 / np.var(power) == pytest.approx(over.n_independent, rel=0.08)
    assert over.n_independent == pytest.approx(10)  # 1 2 3 4 5 5 5 5 4 3 2 1: 40^2 / 160


def test_noise_alone_is_one_source_and_one_look_at_an_uneven_array_shows_no_more():
    rng = np.random.default_rng(724)
    noise = snapshots(line(8), np.zeros((N, 1, 1)), NOISE, rng, np.zeros((N, 1)))
    assert np.mean(estimate_n_sources(noise, line(8), np.full(N, NOISE), "mdl") == 1) > 0.98
    uneven = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1])[:, None] * [0, 1, 0])
    x = sources(uneven, 2, 10, rng)
    assert np.all(estimate_n_sources(x, uneven, np.full(10, NOISE), "mdl") == 1)


@pytest.mark.parametrize("member", [Capon, Esprit, MaximumLikelihood, Music, RootMusic])
def test_each_method_finds_as_many_directions_as_there_are(member):
    rng, array = np.random.default_rng(725), line(12)
    x = np.concatenate([sources(array, count, 300, rng) for count in (1, 2)])
    found = member(n_sources="mdl").directions(x, array, np.full(600, NOISE))
    counts = np.sum(np.isfinite(found.azimuth_rad), axis=1)
    assert np.array_equal(counts, np.sum(np.isfinite(found.azimuth_std_rad), axis=1))
    assert np.mean(counts[:300] == 1) > 0.85
    assert np.mean(counts[300:] == 2) > 0.95


def test_a_second_source_passes_by_chance_as_often_as_the_highest_of_so_many_beams():
    # Noise has some 2 n beams to be highest in, an exponential power in each: 2 n exp(-price)
    # at most, with price 5/2 ln n for mdl.
    array, rng = line(12), np.random.default_rng(726)
    x = sources(array, 1, N, rng)
    found = MaximumLikelihood(n_sources="mdl").find_directions(x, array, np.full(N, NOISE))
    share = np.mean(np.isfinite(found.azimuth_rad[:, 1]))
    assert 0 < share < 24 * 12**-2.5 + 5 * np.sqrt(0.05 / N)
    found = MaximumLikelihood(n_sources="aic").find_directions(x, array, np.full(N, NOISE))
    assert np.mean(np.isfinite(found.azimuth_rad[:, 1])) > 0.3  # cheap: 3 for 2 n chances


def test_without_noise_rounding_is_no_source():
    array, rng = line(12), np.random.default_rng(727)
    x = sources(array, 2, 20, rng, noise=0.0).astype(np.complex64)
    for member in (Esprit, MaximumLikelihood):
        found = member(n_sources="mdl").find_directions(x, array, np.zeros(20))
        assert np.all(np.sum(np.isfinite(found.azimuth_rad), axis=1) == 2)
