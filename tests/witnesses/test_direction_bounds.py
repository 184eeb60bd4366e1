"""Cramer-Rao bound on directions of several sources against a numerical Fisher matrix."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.theory.bounds import crlb_angle
from dechirp.theory.direction_bounds import direction_std_rad, unit_vector_derivatives, unit_vectors

RNG = np.random.default_rng(71)
POSITIONS = RNG.uniform(-2, 2, (9, 3)) * [0.2, 1, 1]
AZIMUTH, ELEVATION = np.array([-0.5, 0.1, 0.9]), np.array([0.2, -0.3, 0.4])
AMPLITUDES = RNG.normal(size=(3, 2)) + 1j * RNG.normal(size=(3, 2))


def compute_fisher_std(positions, azimuth, elevation, amplitudes, noise_power, unknown):
    """Compute square roots of the diagonal of the inverse of the full Fisher matrix.

    Parameters include the amplitudes; derivatives are central differences.
    """
    k, n_snapshots = amplitudes.shape
    n_unknown = sum(unknown)

    def mean(parameters):
        angles = np.stack([azimuth, elevation], axis=1)
        angles[:, list(unknown)] = parameters[: k * n_unknown].reshape(k, n_unknown)
        s = parameters[k * n_unknown :].reshape(2, k, n_snapshots)
        sideways = np.cos(angles[:, 1]) * np.sin(angles[:, 0])
        forward = np.cos(angles[:, 1]) * np.cos(angles[:, 0])
        path_wavelengths = np.outer(positions[:, 0], forward) + np.outer(positions[:, 1], sideways)
        path_wavelengths += np.outer(positions[:, 2], np.sin(angles[:, 1]))
        return (np.exp(-2j * np.pi * path_wavelengths) @ (s[0] + 1j * s[1])).ravel()

    unknown_angles = np.stack([azimuth, elevation], axis=1)[:, list(unknown)].ravel()
    point = np.concatenate([unknown_angles, amplitudes.real.ravel(), amplitudes.imag.ravel()])
    step = 1e-5
    jacobian = np.stack(
        [
            (mean(point + step * e) - mean(point - step * e)) / (2 * step)
            for e in np.eye(len(point))
        ],
        axis=1,
    )
    information = 2 / noise_power * np.real(jacobian.conj().T @ jacobian)
    std = np.zeros((k, 2))
    std[:, list(unknown)] = np.sqrt(np.diag(np.linalg.inv(information)))[: k * n_unknown].reshape(
        k, -1
    )
    return std


@pytest.mark.parametrize("unknown", [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("n_sources", [1, 2, 3])
def test_bound_matches_inverse_of_full_fisher_matrix(unknown, n_sources):
    sources = AZIMUTH[:n_sources], ELEVATION[:n_sources], AMPLITUDES[:n_sources]
    bound = direction_std_rad(
        positions=POSITIONS,
        azimuth_rad=sources[0],
        elevation_rad=sources[1],
        amplitudes=sources[2],
        noise_power=0.3,
        unknown=unknown,
    )
    # The error of differences over 1e-5 is 1e-10 times third derivatives of some hundreds.
    assert bound == pytest.approx(compute_fisher_std(POSITIONS, *sources, 0.3, unknown), rel=1e-5)


def test_bound_for_one_source_and_linear_array_equals_angle_bound():
    sideways_m = np.array([0.0, 0.5, 1.5, 4.0])
    positions = np.stack([0 * sideways_m, sideways_m, 0 * sideways_m], axis=1)
    for azimuth in (-1.2, 0.0, 0.7):
        bound = direction_std_rad(
            positions=positions, azimuth_rad=[azimuth], amplitudes=[3.0], noise_power=0.5
        )
        angle_std = crlb_angle(
            snr=9 / 0.5, positions_m=sideways_m, wavelength_m=1.0, angle_rad=azimuth
        )
        assert bound == pytest.approx(np.array([[float(angle_std), 0.0]]), rel=1e-9)


def test_snapshots_add_their_powers():
    single_snapshot_std, two_snapshot_std = (
        direction_std_rad(
            positions=POSITIONS, azimuth_rad=[0.3], amplitudes=[snapshots], noise_power=1.0
        )[0, 0]
        for snapshots in ([5.0], [3.0, 4.0])
    )
    assert two_snapshot_std == pytest.approx(single_snapshot_std, rel=1e-12)


def test_unresolvable_angles_have_infinite_bound():
    positions = np.stack([0 * AZIMUTH, [0, 0.5, 1.0], 0 * AZIMUTH], axis=1)
    std = direction_std_rad(
        positions=positions,
        azimuth_rad=[0.3],
        amplitudes=[1.0],
        noise_power=1.0,
        unknown=(True, True),
    )
    assert np.isinf(std[0, 1])
    crowded_std = direction_std_rad(
        positions=positions, azimuth_rad=AZIMUTH, amplitudes=[1.0, 1.0, 1.0], noise_power=1.0
    )
    assert np.all(crowded_std[:, 0] > 1e3)


def test_unit_vector_derivatives_match_differences():
    step = 1e-6
    azimuth = (unit_vectors(0.4 + step, 0.3) - unit_vectors(0.4 - step, 0.3)) / (2 * step)
    elevation = (unit_vectors(0.4, 0.3 + step) - unit_vectors(0.4, 0.3 - step)) / (2 * step)
    assert unit_vector_derivatives(0.4, 0.3) == pytest.approx(
        np.stack([azimuth, elevation]), abs=1e-9
    )
    assert np.linalg.norm(unit_vectors(AZIMUTH, ELEVATION), axis=1) == pytest.approx(1)


def test_rejects_positions_of_wrong_shape():
    with pytest.raises(dc.InvalidSetting, match="positions"):
        direction_std_rad(positions=[0, 0.5], azimuth_rad=[0.0], amplitudes=[1.0], noise_power=1.0)
