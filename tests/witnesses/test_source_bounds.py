"""Bounds on the directions of several sources, against closed forms and plain matrices."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.theory.direction_bounds import direction_std_rad

AZIMUTH_RAD = np.radians([-20.0, 5.0])
LINE = np.arange(8) / 2
# Differences of these six elements contain every spacing up to 8: a nested array.
NESTED = np.array([0, 1, 2, 3, 7, 11]) / 2


def test_bound_of_one_random_source_has_the_closed_form():
    # Stoica and Nehorai 1990: var = s (1 + s / (M p)) / (2 N p |d|^2), d orthogonal to a.
    power, noise, n = 3.0, 2.0, 50
    slopes = 2 * np.pi * np.cos(0.3) * (LINE - LINE.mean())
    expected = noise / (2 * n * power * np.sum(slopes**2)) * (1 + noise / (len(LINE) * power))

    bound = dc.theory.crlb_directions(LINE, [0.3], [power], noise, n, "stochastic")

    assert bound.item() == pytest.approx(expected, rel=1e-10)


def test_deterministic_bound_equals_that_of_known_snapshots():
    rng = np.random.default_rng(1)
    snapshots = rng.normal(size=(2, 40)) + 1j * rng.normal(size=(2, 40))
    covariance = snapshots @ snapshots.conj().T / 40
    positions = np.stack([0 * LINE, LINE, 0 * LINE], axis=1)

    bound = dc.theory.crlb_directions(LINE, AZIMUTH_RAD, covariance, 0.5, 40)

    std_rad = direction_std_rad(
        positions=positions, azimuth_rad=AZIMUTH_RAD, amplitudes=snapshots, noise_power=0.5
    )
    assert np.sqrt(np.diag(bound)) == pytest.approx(std_rad[:, 0], rel=1e-9)


def test_models_are_ordered_by_what_they_know():
    powers = [2.0, 1.0]
    deterministic, uncorrelated, stochastic = (
        np.diag(dc.theory.crlb_directions(LINE, AZIMUTH_RAD, powers, 1.0, 100, model))
        for model in ("deterministic", "uncorrelated", "stochastic")
    )

    assert np.all(uncorrelated < stochastic)
    assert np.all(deterministic < stochastic)


def test_sparse_array_resolves_more_uncorrelated_sources_than_elements():
    azimuth = np.radians(np.linspace(-50, 50, 8))

    def bound(positions, model):
        return dc.theory.crlb_directions(positions, azimuth, np.ones(8), 0.1, 500, model)

    assert np.all(np.isfinite(bound(NESTED, "uncorrelated")))
    assert np.all(np.isinf(bound(NESTED, "deterministic")))
    assert np.all(np.isinf(bound(np.arange(6) / 2, "uncorrelated")))


@pytest.mark.parametrize(
    ("changes", "setting"),
    [
        ({"positions": [[0, 1]]}, "positions"),
        ({"positions": [0, np.nan]}, "positions"),
        ({"azimuth_rad": [0.0, 2.0]}, "azimuth_rad"),
        ({"azimuth_rad": []}, "azimuth_rad"),
        ({"source_covariance": np.eye(3)}, "source_covariance"),
        ({"source_covariance": [[1, 2], [3, 4]]}, "source_covariance"),
        ({"source_covariance": [[1, 2], [2, 1]]}, "source_covariance"),
        ({"noise_power": 0.0}, "noise_power"),
        ({"n_snapshots": 0}, "n_snapshots"),
        ({"model": "random"}, "model"),
        (
            {"model": "uncorrelated", "source_covariance": [[1, 0.1], [0.1, 1]]},
            "source_covariance",
        ),
    ],
)
def test_wrong_argument_is_named(changes, setting):
    arguments = {
        "positions": LINE,
        "azimuth_rad": AZIMUTH_RAD,
        "source_covariance": np.ones(2),
        "noise_power": 1.0,
        "n_snapshots": 10,
    } | changes

    with pytest.raises(dc.InvalidSetting, match=setting):
        dc.theory.crlb_directions(**arguments)


@pytest.mark.parametrize("model", ["deterministic", "stochastic", "uncorrelated"])
@pytest.mark.parametrize("azimuths_rad", [[0.1, 0.1], [-np.pi / 6, np.pi / 6]])
def test_sources_with_the_same_phases_have_no_bound(model, azimuths_rad):
    """Equal directions, and those that differ by a turn between elements a wavelength apart."""
    bounds = dc.theory.crlb_directions(np.arange(8), azimuths_rad, np.ones(2), 1.0, 100, model)
    assert np.isinf(bounds).all()
