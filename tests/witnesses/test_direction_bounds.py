"""The bound on directions of several sources: against a Fisher matrix made by differences."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.theory.bounds import angle_std_rad
from dechirp.theory.direction_bounds import direction_std_rad, unit_vector_derivatives, unit_vectors

RNG = np.random.default_rng(71)
POSITIONS = RNG.uniform(-2, 2, (9, 3)) * [0.2, 1, 1]
AZIMUTH, ELEVATION = np.array([-0.5, 0.1, 0.9]), np.array([0.2, -0.3, 0.4])
AMPLITUDES = RNG.normal(size=(3, 2)) + 1j * RNG.normal(size=(3, 2))


def fisher_std(positions, azimuth, elevation, amplitudes, noise_power, tells):
    """Square roots of the diagonal of the inverse of the whole Fisher matrix.

    Of all parameters, amplitudes included, with derivatives by central differences.
    """
    k, n_looks = amplitudes.shape
    n_told = sum(tells)

    def mean(parameters):
        angles = np.stack([azimuth, elevation], axis=1)
        angles[:, list(tells)] = parameters[: k * n_told].reshape(k, n_told)
        s = parameters[k * n_told :].reshape(2, k, n_looks)
        left = np.cos(angles[:, 1]) * np.sin(angles[:, 0])
        ahead = np.cos(angles[:, 1]) * np.cos(angles[:, 0])
        way = np.outer(positions[:, 0], ahead) + np.outer(positions[:, 1], left)
        way += np.outer(positions[:, 2], np.sin(angles[:, 1]))
        return (np.exp(-2j * np.pi * way) @ (s[0] + 1j * s[1])).ravel()

    told = np.stack([azimuth, elevation], axis=1)[:, list(tells)].ravel()
    at = np.concatenate([told, amplitudes.real.ravel(), amplitudes.imag.ravel()])
    step = 1e-5
    jacobian = np.stack(
        [(mean(at + step * e) - mean(at - step * e)) / (2 * step) for e in np.eye(len(at))], axis=1
    )
    information = 2 / noise_power * np.real(jacobian.conj().T @ jacobian)
    std = np.zeros((k, 2))
    std[:, list(tells)] = np.sqrt(np.diag(np.linalg.inv(information)))[: k * n_told].reshape(k, -1)
    return std


@pytest.mark.parametrize("tells", [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("n_sources", [1, 2, 3])
def test_the_bound_is_the_inverse_of_the_whole_fisher_matrix(tells, n_sources):
    which = AZIMUTH[:n_sources], ELEVATION[:n_sources], AMPLITUDES[:n_sources]
    bound = direction_std_rad(
        positions=POSITIONS,
        azimuth_rad=which[0],
        elevation_rad=which[1],
        amplitudes=which[2],
        noise_power=0.3,
        unknown=tells,
    )
    # Differences over 1e-5 are exact to 1e-10 times third derivatives of some hundreds.
    assert bound == pytest.approx(fisher_std(POSITIONS, *which, 0.3, tells), rel=1e-5)


def test_of_one_source_on_a_line_it_is_the_bound_on_an_angle():
    left = np.array([0.0, 0.5, 1.5, 4.0])
    positions = np.stack([0 * left, left, 0 * left], axis=1)
    for azimuth in (-1.2, 0.0, 0.7):
        bound = direction_std_rad(
            positions=positions, azimuth_rad=[azimuth], amplitudes=[3.0], noise_power=0.5
        )
        line = angle_std_rad(snr=9 / 0.5, positions_m=left, wavelength_m=1.0, angle_rad=azimuth)
        assert bound == pytest.approx(np.array([[float(line), 0.0]]), rel=1e-9)


def test_looks_count_as_their_powers_add():
    one, many = (
        direction_std_rad(
            positions=POSITIONS, azimuth_rad=[0.3], amplitudes=[looks], noise_power=1.0
        )[0, 0]
        for looks in ([5.0], [3.0, 4.0])
    )
    assert many == pytest.approx(one, rel=1e-12)


def test_what_the_array_does_not_tell_has_no_bound():
    line = np.stack([0 * AZIMUTH, [0, 0.5, 1.0], 0 * AZIMUTH], axis=1)
    both = direction_std_rad(
        positions=line, azimuth_rad=[0.3], amplitudes=[1.0], noise_power=1.0, unknown=(True, True)
    )
    assert np.isinf(both[0, 1])
    crowded = direction_std_rad(
        positions=line, azimuth_rad=AZIMUTH, amplitudes=[1.0, 1.0, 1.0], noise_power=1.0
    )
    assert np.all(crowded[:, 0] > 1e3)


def test_slopes_are_those_of_the_unit_vectors():
    step = 1e-6
    azimuth = (unit_vectors(0.4 + step, 0.3) - unit_vectors(0.4 - step, 0.3)) / (2 * step)
    elevation = (unit_vectors(0.4, 0.3 + step) - unit_vectors(0.4, 0.3 - step)) / (2 * step)
    assert unit_vector_derivatives(0.4, 0.3) == pytest.approx(
        np.stack([azimuth, elevation]), abs=1e-9
    )
    assert np.linalg.norm(unit_vectors(AZIMUTH, ELEVATION), axis=1) == pytest.approx(1)


def test_positions_in_a_wrong_shape_are_refused():
    with pytest.raises(dc.InvalidSetting, match="positions"):
        direction_std_rad(positions=[0, 0.5], azimuth_rad=[0.0], amplitudes=[1.0], noise_power=1.0)
