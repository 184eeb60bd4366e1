"""Snapshots from a covariance, and estimators without smoothing against their definitions."""

import numpy as np
import pytest

import dechirp as dc

POSITIONS = 0.5 * np.arange(8)
AZIMUTH = np.radians(np.arange(-80, 81, 5.0))


def draw_snapshots(n_snapshots):
    rng = np.random.default_rng(4)
    steering = np.exp(-2j * np.pi * np.outer(np.sin([-0.3, 0.2]), POSITIONS))
    shape = n_snapshots, 10
    values = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    return values[:, :2] @ steering + 0.1 * values[:, 2:]


@pytest.mark.parametrize("n_snapshots", [3, 8, 50])
def test_sample_covariance_of_snapshots_is_the_given_one(n_snapshots):
    original = draw_snapshots(n_snapshots)
    covariance = original.T @ original.conj() / n_snapshots
    snapshots = dc.angle.snapshots_from_covariance([covariance] * 2, n_snapshots=n_snapshots)
    assert snapshots.shape == (2, n_snapshots, 8)
    np.testing.assert_allclose(
        snapshots[1].T @ snapshots[1].conj() / n_snapshots, covariance, atol=1e-13
    )
    for kind in ("bartlett", "capon", "music", "root-music"):
        arguments = {"n_sources": 2, "kind": kind, "noise_power": 0.02}
        expected = dc.angle.estimate_directions(original, POSITIONS, **arguments)
        result = dc.angle.estimate_directions(snapshots[0], POSITIONS, **arguments)
        np.testing.assert_allclose(result.azimuth_rad, expected.azimuth_rad, atol=1e-6)
        np.testing.assert_allclose(result.azimuth_std_rad, expected.azimuth_std_rad, rtol=1e-3)


def test_number_of_snapshots_decides_the_number_of_sources():
    # Minimum description length, M. Wax and T. Kailath, IEEE Trans. ASSP 33(2), 1985: a second
    # source 6 dB below the noise of an element counts in many snapshots only.
    steering = np.exp(-2j * np.pi * np.outer(POSITIONS, np.sin([-0.3, 0.5])))
    covariance = steering @ np.diag([10, 0.25]) @ steering.conj().T + np.eye(8)
    n_sources = []
    for n in (10, 10_000):
        snapshots = dc.angle.snapshots_from_covariance(covariance, n_snapshots=n)
        directions = dc.angle.music(snapshots, POSITIONS, "mdl", noise_power=1.0)
        n_sources.append(np.isfinite(directions.azimuth_rad).sum())
    assert n_sources == [1, 2]


def test_whole_array_gives_the_spectrum_of_the_forward_backward_average():
    original = draw_snapshots(50)
    covariance = original.T @ original.conj() / 50
    average = (covariance + covariance[::-1, ::-1].conj()) / 2
    steering = np.exp(-2j * np.pi * np.outer(POSITIONS, np.sin(AZIMUTH)))
    noise_space = np.linalg.eigh(average)[1][:, :-2]
    distance = np.linalg.norm(noise_space.conj().T @ steering, axis=0) ** 2

    music = dc.angle.Music(smoothing=dc.angle.Smoothing(share=1))
    snapshots = dc.angle.snapshots_from_covariance(covariance)
    spectrum = dc.angle.direction_spectrum(snapshots, POSITIONS, AZIMUTH, n_sources=2, kind=music)
    np.testing.assert_allclose(spectrum * distance / (spectrum[0] * distance[0]), 1, rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"covariance": [[1, 2], [0, 1]]}, "^covariance: a matrix that is no covariance"),
        ({"covariance": [[1, 2], [2, 1]]}, "^covariance: a matrix that is no covariance"),
        ({"covariance": np.ones((2, 3))}, r"^covariance: an array \(2, 3\)"),
        ({"covariance": [1.0, 2.0]}, r"^covariance: an array \(2,\)"),
        ({"covariance": np.eye(4), "n_snapshots": 3}, "^n_snapshots: 3; expected at least 4"),
        ({"covariance": np.eye(4), "n_snapshots": 0}, "^n_snapshots: 0; expected a whole number"),
    ],
)
def test_wrong_covariance_is_named(arguments, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        dc.angle.snapshots_from_covariance(**arguments)
