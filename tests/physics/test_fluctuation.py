"""Echoes that fade and flare as Swerling's cases say."""

import numpy as np
import pytest
from scipy import stats

import dechirp as dc
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.fluctuation import draw_power_factors
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

N = 20_000
# Mean 1: exponential, and chi-square with 4 degrees of freedom.
LAWS = {
    "swerling-1": stats.expon(),
    "swerling-2": stats.expon(),
    "swerling-3": stats.gamma(2, scale=0.5),
    "swerling-4": stats.gamma(2, scale=0.5),
}
PER_FRAME, PER_CHIRP = ("swerling-1", "swerling-3"), ("swerling-2", "swerling-4")


def cloud(n, kind):
    body = PointCloud(positions_m=np.zeros((n, 3)), rcs_m2=np.ones(n))
    return Target(position_m=(20, 0, 0), body=body, fluctuation=kind)


def factors(kind, n_scatterers, n_chirps, seed):
    rng = np.random.default_rng(seed)
    return draw_power_factors(Scene(targets=[cloud(n_scatterers, kind)]), n_chirps, rng)


def must_follow(sample, law):
    """By chance once in a million seeds; this one is fixed."""
    assert stats.kstest(sample, law.cdf).pvalue > 1e-6
    # Five standard errors of the mean and of the variance.
    kurtosis = float(law.stats("k")) + 3
    n, variance = len(sample), law.var()
    assert sample.mean() == pytest.approx(1, abs=5 * np.sqrt(variance / n))
    spread = variance * np.sqrt((kurtosis - 1) / n)
    assert sample.var() == pytest.approx(variance, abs=5 * spread)


@pytest.mark.parametrize("kind", PER_FRAME)
def test_from_frame_to_frame_powers_follow_their_law(kind):
    per_frame, per_chirp = factors(kind, N, 4, seed=81)

    assert per_chirp is None
    must_follow(per_frame, LAWS[kind])
    rng, scene = np.random.default_rng(82), Scene(targets=[cloud(1, kind)])
    frames = np.array([draw_power_factors(scene, 4, rng)[0][0] for _ in range(2000)])
    must_follow(frames, LAWS[kind])
    # Frames do not depend on each other: five standard errors of a correlation.
    assert abs(np.corrcoef(frames[1:], frames[:-1])[0, 1]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize("kind", PER_CHIRP)
def test_from_chirp_to_chirp_powers_follow_their_law(kind):
    per_frame, per_chirp = factors(kind, 100, N // 100, seed=83)

    assert (per_frame == 1).all()
    assert per_chirp.shape == (N // 100, 100)
    must_follow(per_chirp.ravel(), LAWS[kind])
    for one, other in ((per_chirp[1:], per_chirp[:-1]), (per_chirp[:, 1:], per_chirp[:, :-1])):
        correlation = np.corrcoef(one.ravel(), other.ravel())[0, 1]
        assert abs(correlation) < 5 / np.sqrt(one.size)


def test_each_scatterer_follows_the_law_of_its_own_target():
    kinds = ("swerling-4", "steady", "swerling-1", "swerling-2", "swerling-3")
    scene = Scene(targets=[cloud(3, kind) for kind in kinds])
    per_frame, per_chirp = draw_power_factors(scene, 16, np.random.default_rng(84))

    varies_by_frame = np.repeat([kind in PER_FRAME for kind in kinds], 3)
    varies_by_chirp = np.repeat([kind in PER_CHIRP for kind in kinds], 3)
    assert ((per_frame != 1) == varies_by_frame).all()
    assert ((per_chirp != 1).all(axis=0) == varies_by_chirp).all()
    assert ((per_chirp == 1).all(axis=0) == ~varies_by_chirp).all()
    assert len(np.unique(per_frame[varies_by_frame])) == 6


def test_steady_targets_draw_nothing():
    rng = np.random.default_rng(85)
    before = rng.bit_generator.state
    per_frame, per_chirp = draw_power_factors(Scene(targets=[cloud(5, "steady")]), 16, rng)

    assert (per_frame == 1).all()
    assert per_chirp is None
    assert rng.bit_generator.state == before
    assert draw_power_factors(Scene(), 16, rng)[0].shape == (0,)


def test_the_same_seed_gives_the_same_fading():
    for kind in LAWS:
        for one, other in zip(factors(kind, 7, 5, 86), factors(kind, 7, 5, 86), strict=True):
            assert np.array_equal(one, other)


@pytest.mark.parametrize("kind", ["swerling-5", "Swerling-1", None, 1])
def test_a_case_that_swerling_does_not_have_is_refused(kind):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.fluctuation.*one of steady, swerling-1"):
        Target(position_m=(20, 0, 0), fluctuation=kind)
