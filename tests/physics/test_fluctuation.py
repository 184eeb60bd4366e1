"""Swerling fluctuation of target cross sections."""

import numpy as np
import pytest
from scipy import stats

import dechirp as dc
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.fluctuation import draw_fluctuation_factors
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

N_DRAWS = 20_000
# Distributions of unit mean: exponential, and chi-square with 4 degrees of freedom.
LAWS = {
    "swerling-1": stats.expon(),
    "swerling-2": stats.expon(),
    "swerling-3": stats.gamma(2, scale=0.5),
    "swerling-4": stats.gamma(2, scale=0.5),
}
PER_FRAME, PER_CHIRP = ("swerling-1", "swerling-3"), ("swerling-2", "swerling-4")


def make_cloud(n, kind):
    body = PointCloud(positions_m=np.zeros((n, 3)), rcs_m2=np.ones(n))
    return Target(position_m=(20, 0, 0), body=body, fluctuation=kind)


def draw_factors(kind, n_scatterers, n_chirps, seed):
    rng = np.random.default_rng(seed)
    return draw_fluctuation_factors(Scene(targets=[make_cloud(n_scatterers, kind)]), n_chirps, rng)


def assert_follows_law(sample, law):
    """Check distribution, mean and variance; a random seed fails once in a million."""
    assert stats.kstest(sample, law.cdf).pvalue > 1e-6
    # Tolerances are five standard errors of the mean and of the variance.
    kurtosis = float(law.stats("k")) + 3
    n, variance = len(sample), law.var()
    assert sample.mean() == pytest.approx(1, abs=5 * np.sqrt(variance / n))
    spread = variance * np.sqrt((kurtosis - 1) / n)
    assert sample.var() == pytest.approx(variance, abs=5 * spread)


@pytest.mark.parametrize("kind", PER_FRAME)
def test_frame_to_frame_fluctuation_follows_its_distribution(kind):
    per_frame, per_chirp = draw_factors(kind, N_DRAWS, 4, seed=81)

    assert per_chirp is None
    assert_follows_law(per_frame, LAWS[kind])
    rng, scene = np.random.default_rng(82), Scene(targets=[make_cloud(1, kind)])
    frames = np.array([draw_fluctuation_factors(scene, 4, rng)[0][0] for _ in range(2000)])
    assert_follows_law(frames, LAWS[kind])
    # Frames are independent: five standard errors of a correlation.
    assert abs(np.corrcoef(frames[1:], frames[:-1])[0, 1]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize("kind", PER_CHIRP)
def test_chirp_to_chirp_fluctuation_follows_its_distribution(kind):
    per_frame, per_chirp = draw_factors(kind, 100, N_DRAWS // 100, seed=83)

    assert (per_frame == 1).all()
    assert per_chirp.shape == (N_DRAWS // 100, 100)
    assert_follows_law(per_chirp.ravel(), LAWS[kind])
    for first, second in ((per_chirp[1:], per_chirp[:-1]), (per_chirp[:, 1:], per_chirp[:, :-1])):
        correlation = np.corrcoef(first.ravel(), second.ravel())[0, 1]
        assert abs(correlation) < 5 / np.sqrt(first.size)


def test_scatterers_follow_fluctuation_of_their_target():
    kinds = ("swerling-4", "steady", "swerling-1", "swerling-2", "swerling-3")
    scene = Scene(targets=[make_cloud(3, kind) for kind in kinds])
    per_frame, per_chirp = draw_fluctuation_factors(scene, 16, np.random.default_rng(84))

    varies_by_frame = np.repeat([kind in PER_FRAME for kind in kinds], 3)
    varies_by_chirp = np.repeat([kind in PER_CHIRP for kind in kinds], 3)
    assert ((per_frame != 1) == varies_by_frame).all()
    assert ((per_chirp != 1).all(axis=0) == varies_by_chirp).all()
    assert ((per_chirp == 1).all(axis=0) == ~varies_by_chirp).all()
    assert len(np.unique(per_frame[varies_by_frame])) == 6


def test_steady_targets_draw_no_random_numbers():
    rng = np.random.default_rng(85)
    initial_state = rng.bit_generator.state
    per_frame, per_chirp = draw_fluctuation_factors(
        Scene(targets=[make_cloud(5, "steady")]), 16, rng
    )

    assert (per_frame == 1).all()
    assert per_chirp is None
    assert rng.bit_generator.state == initial_state
    assert draw_fluctuation_factors(Scene(), 16, rng)[0].shape == (0,)


def test_seed_determines_fluctuation():
    for kind in LAWS:
        for first, second in zip(
            draw_factors(kind, 7, 5, 86), draw_factors(kind, 7, 5, 86), strict=True
        ):
            assert np.array_equal(first, second)


@pytest.mark.parametrize("kind", ["swerling-5", "Swerling-1", None, 1])
def test_rejects_unknown_swerling_case(kind):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.fluctuation.*one of steady, swerling-1"):
        Target(position_m=(20, 0, 0), fluctuation=kind)
