"""Mutual coupling: a steering vector a becomes C a."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.leakage import Leakage
from dechirp.simulation.impairments.mutual_coupling import MutualCoupling

# Three places, not in a line, so that distances differ.
PLACES_M = [(0, 0, 0), (0, 1.9e-3, 0), (0, 5.7e-3, 1e-3)]
MATRIX = np.array([[1, 0.1 - 0.05j, 0.02j], [0.12 + 0.03j, 0.9j, -0.1], [0.01, 0.07 - 0.07j, 1.1]])
SCENE = dc.Scene(
    targets=[
        dc.Target(position_m=(20, 7, 1), velocity_m_per_s=(-4, 1, 0)),
        dc.Target(position_m=(12, -5, 0), rcs_m2=0.3),
    ]
)


def written(matrix):
    return [[[entry.real, entry.imag] for entry in row] for row in matrix]


@pytest.fixture
def mimo(radar) -> dc.Radar:
    """Three transmitters in turn and three receivers."""
    array = dc.Array(tx_m=PLACES_M, rx_m=PLACES_M)
    return replace(
        radar,
        array=array,
        frame=replace(radar.frame, n_chirps=4, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2))),
    )


def samples(radar, *impairments):
    return dc.simulate(SCENE, radar, impairments=impairments, dtype=np.complex128).values[0]


def test_receivers_that_are_coupled_see_the_matrix_times_the_steering_vector(mimo):
    clean = samples(mimo)
    coupled = samples(mimo, MutualCoupling(rx_matrix=written(MATRIX)))

    expected = np.einsum("ij,mjn->min", MATRIX, clean)
    np.testing.assert_allclose(coupled, expected, atol=1e-12 * abs(clean).max())


def test_transmitters_that_are_coupled_send_the_matrix_times_the_steering_vector(radar):
    # At rest, chirps differ by who sends alone: what coupling mixes is known exactly.
    still = dc.Scene(targets=[replace(one, velocity_m_per_s=(0, 0, 0)) for one in SCENE.targets])
    array = dc.Array(tx_m=PLACES_M)
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)))
    radar = replace(radar, array=array, frame=frame)
    clean, coupled = (
        dc.simulate(still, radar, impairments=chosen, dtype=np.complex128).values[0, :, 0]
        for chosen in ((), [MutualCoupling(tx_matrix=written(MATRIX))])
    )

    expected = MATRIX @ clean[:3]
    np.testing.assert_allclose(coupled[:3], expected, atol=1e-9 * abs(clean).max())
    np.testing.assert_allclose(coupled[3:], expected, atol=1e-9 * abs(clean).max())


def test_a_level_between_neighbours_falls_with_the_distance_like_a_wave(mimo):
    coupled = samples(mimo, MutualCoupling(rx_level=0.01, rx_phase_rad=0.7))
    clean = samples(mimo)

    wavenumber = 2 * np.pi / mimo.frame.chirp.wavelength_m
    at_m = np.array(PLACES_M)
    apart_m = np.linalg.norm(at_m[:, None] - at_m, axis=-1) + np.eye(3)
    matrix = 0.1 * 1.9e-3 / apart_m * np.exp(1j * (0.7 + wavenumber * (apart_m - 1.9e-3)))
    np.fill_diagonal(matrix, 1)
    # -20 dB to the neighbour, and 9.8 dB less three times as far.
    assert 20 * np.log10(abs(matrix[0])) == pytest.approx([0, -20, -29.68], abs=0.01)
    expected = np.einsum("ij,mjn->min", matrix, clean)
    np.testing.assert_allclose(coupled, expected, atol=1e-9 * abs(clean).max())


def test_leakage_that_comes_first_is_coupled_too(mimo):
    leakage, coupling = Leakage(isolation=1e6), MutualCoupling(rx_matrix=written(MATRIX))
    clean, leaking = samples(mimo), samples(mimo, leakage)

    after = samples(mimo, leakage, coupling)
    before = samples(mimo, coupling, leakage)
    scale = abs(leaking).max()
    np.testing.assert_allclose(after, np.einsum("ij,mjn->min", MATRIX, leaking), atol=1e-12 * scale)
    mixed = np.einsum("ij,mjn->min", MATRIX, clean)
    np.testing.assert_allclose(before, mixed + leaking - clean, atol=1e-9 * scale)


def test_frames_are_coupled_one_by_one(mimo):
    coupling = MutualCoupling(rx_matrix=written(MATRIX), tx_level=0.02)
    two = dc.simulate(SCENE, mimo, impairments=[coupling], n_frames=2, dtype=np.complex128)

    np.testing.assert_array_equal(two.values[0], samples(mimo, coupling))


def test_an_antenna_alone_is_not_coupled(radar):
    coupling = MutualCoupling(tx_level=0.1)
    np.testing.assert_array_equal(samples(radar, coupling), samples(radar))


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"rx_level": 2}, "MutualCoupling.rx_level: 2"),
        ({"tx_level": 0}, "MutualCoupling.tx_level: 0"),
        (
            {"rx_matrix": [[(1, 0), (0, 0)]]},
            "MutualCoupling.rx_matrix: rows of 2; .* a square matrix",
        ),
        ({"rx_matrix": 3}, "MutualCoupling.rx_matrix: rows of nothing"),
        ({"tx_matrix": [[1.0]]}, r"MutualCoupling.tx_matrix.* entries \[real, imaginary\]"),
        ({"tx_matrix": [[(float("nan"), 0)]]}, "MutualCoupling.tx_matrix: nan"),
        (
            {"tx_matrix": [[(1, 0)]], "tx_level": 0.1},
            "MutualCoupling.tx_matrix: a matrix in addition to tx_level",
        ),
    ],
)
def test_a_matrix_that_cannot_be_is_refused(wrong, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        MutualCoupling(**wrong)


def test_a_matrix_of_another_size_is_refused_with_the_number_of_antennas(mimo, radar):
    with pytest.raises(dc.InvalidSetting, match="rx_matrix: 3 x 3; expected 2 x 2: radar"):
        samples(radar, MutualCoupling(rx_matrix=written(MATRIX)))
    with pytest.raises(dc.InvalidSetting, match="tx_matrix: 1 x 1; expected 3 x 3"):
        samples(mimo, MutualCoupling(tx_matrix=[[(1, 0)]]))


def test_a_level_for_antennas_at_one_place_is_refused(mimo):
    same = replace(mimo, array=replace(mimo.array, rx_m=[(0, 0, 0), (0, 0, 0)]))
    with pytest.raises(dc.InvalidSetting, match="rx_level: a level, with coincident antennas"):
        MutualCoupling(rx_level=0.1).check(SCENE, same)


def test_settings_files_say_levels_and_matrices():
    text = "{kind: mutual-coupling, rx_level: -20 dB, rx_phase: 0.5 rad, tx_matrix: [[[1, 0]]]}"
    made = MutualCoupling(rx_level=0.01, rx_phase_rad=0.5, tx_matrix=[[(1.0, 0.0)]])

    assert parse_settings(text, Impairment) == made
    assert parse_settings(dump(made), Impairment) == made
