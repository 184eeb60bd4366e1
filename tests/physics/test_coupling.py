"""Mutual coupling of antennas: the steering vector a becomes C a."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.leakage import Leakage
from dechirp.simulation.impairments.mutual_coupling import MutualCoupling

# Three positions off a line, so that distances differ.
ANTENNAS_M = [(0, 0, 0), (0, 1.9e-3, 0), (0, 5.7e-3, 1e-3)]
MATRIX = np.array([[1, 0.1 - 0.05j, 0.02j], [0.12 + 0.03j, 0.9j, -0.1], [0.01, 0.07 - 0.07j, 1.1]])
SCENE = dc.Scene(
    targets=[
        dc.Target(position_m=(20, 7, 1), velocity_m_per_s=(-4, 1, 0)),
        dc.Target(position_m=(12, -5, 0), rcs_m2=0.3),
    ]
)


def encode_matrix(matrix):
    return [[[entry.real, entry.imag] for entry in row] for row in matrix]


@pytest.fixture
def mimo_radar(radar) -> dc.Radar:
    """Return a radar with three TDM transmitters and three receivers."""
    array = dc.Array(tx_m=ANTENNAS_M, rx_m=ANTENNAS_M)
    return replace(
        radar,
        array=array,
        frame=replace(radar.frame, n_chirps=4, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2))),
    )


def simulate_samples(radar, *impairments):
    return dc.simulate(SCENE, radar, impairments=impairments, dtype=np.complex128).values[0]


def test_receiver_coupling_multiplies_steering_vector_by_matrix(mimo_radar):
    clean = simulate_samples(mimo_radar)
    coupled = simulate_samples(mimo_radar, MutualCoupling(rx_matrix=encode_matrix(MATRIX)))

    expected = np.einsum("ij,mjn->min", MATRIX, clean)
    np.testing.assert_allclose(coupled, expected, atol=1e-12 * abs(clean).max())


def test_transmitter_coupling_multiplies_steering_vector_by_matrix(radar):
    # Chirps of static targets differ by transmitter only, so the coupled samples are known exactly.
    static_scene = dc.Scene(
        targets=[replace(target, velocity_m_per_s=(0, 0, 0)) for target in SCENE.targets]
    )
    array = dc.Array(tx_m=ANTENNAS_M)
    frame = replace(radar.frame, n_chirps=2, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)))
    radar = replace(radar, array=array, frame=frame)
    clean, coupled = (
        dc.simulate(static_scene, radar, impairments=impairments, dtype=np.complex128).values[
            0, :, 0
        ]
        for impairments in ((), [MutualCoupling(tx_matrix=encode_matrix(MATRIX))])
    )

    expected = MATRIX @ clean[:3]
    np.testing.assert_allclose(coupled[:3], expected, atol=1e-9 * abs(clean).max())
    np.testing.assert_allclose(coupled[3:], expected, atol=1e-9 * abs(clean).max())


def test_coupling_level_falls_with_distance_like_spherical_wave(mimo_radar):
    coupled = simulate_samples(mimo_radar, MutualCoupling(rx_level=0.01, rx_phase_rad=0.7))
    clean = simulate_samples(mimo_radar)

    wavenumber = 2 * np.pi / mimo_radar.frame.chirp.wavelength_m
    positions_m = np.array(ANTENNAS_M)
    distances_m = np.linalg.norm(positions_m[:, None] - positions_m, axis=-1) + np.eye(3)
    matrix = 0.1 * 1.9e-3 / distances_m * np.exp(1j * (0.7 + wavenumber * (distances_m - 1.9e-3)))
    np.fill_diagonal(matrix, 1)
    # -20 dB to the neighbour, and 9.8 dB less at three times the distance.
    assert 20 * np.log10(abs(matrix[0])) == pytest.approx([0, -20, -29.68], abs=0.01)
    expected = np.einsum("ij,mjn->min", matrix, clean)
    np.testing.assert_allclose(coupled, expected, atol=1e-9 * abs(clean).max())


def test_coupling_applies_to_preceding_leakage_only(mimo_radar):
    leakage, coupling = Leakage(isolation=1e6), MutualCoupling(rx_matrix=encode_matrix(MATRIX))
    clean, leaking = simulate_samples(mimo_radar), simulate_samples(mimo_radar, leakage)

    leakage_first = simulate_samples(mimo_radar, leakage, coupling)
    coupling_first = simulate_samples(mimo_radar, coupling, leakage)
    scale = abs(leaking).max()
    np.testing.assert_allclose(
        leakage_first, np.einsum("ij,mjn->min", MATRIX, leaking), atol=1e-12 * scale
    )
    mixed = np.einsum("ij,mjn->min", MATRIX, clean)
    np.testing.assert_allclose(coupling_first, mixed + leaking - clean, atol=1e-9 * scale)


def test_coupling_is_equal_in_each_frame(mimo_radar):
    coupling = MutualCoupling(rx_matrix=encode_matrix(MATRIX), tx_level=0.02)
    cube = dc.simulate(SCENE, mimo_radar, impairments=[coupling], n_frames=2, dtype=np.complex128)

    np.testing.assert_array_equal(cube.values[0], simulate_samples(mimo_radar, coupling))


def test_single_antenna_is_not_coupled(radar):
    coupling = MutualCoupling(tx_level=0.1)
    np.testing.assert_array_equal(simulate_samples(radar, coupling), simulate_samples(radar))


@pytest.mark.parametrize(
    ("settings", "message"),
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
def test_rejects_invalid_coupling(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        MutualCoupling(**settings)


def test_rejects_matrix_of_wrong_size(mimo_radar, radar):
    with pytest.raises(dc.InvalidSetting, match="rx_matrix: 3 x 3; expected 2 x 2: radar"):
        simulate_samples(radar, MutualCoupling(rx_matrix=encode_matrix(MATRIX)))
    with pytest.raises(dc.InvalidSetting, match="tx_matrix: 1 x 1; expected 3 x 3"):
        simulate_samples(mimo_radar, MutualCoupling(tx_matrix=[[(1, 0)]]))


def test_rejects_level_for_coincident_antennas(mimo_radar):
    coincident_radar = replace(
        mimo_radar, array=replace(mimo_radar.array, rx_m=[(0, 0, 0), (0, 0, 0)])
    )
    with pytest.raises(dc.InvalidSetting, match="rx_level: a level, with coincident antennas"):
        MutualCoupling(rx_level=0.1).check(SCENE, coincident_radar)


def test_settings_file_round_trips_level_and_matrix():
    text = "{kind: mutual-coupling, rx_level: -20 dB, rx_phase: 0.5 rad, tx_matrix: [[[1, 0]]]}"
    coupling = MutualCoupling(rx_level=0.01, rx_phase_rad=0.5, tx_matrix=[[(1.0, 0.0)]])

    assert parse_settings(text, Impairment) == coupling
    assert parse_settings(dump_yaml(coupling), Impairment) == coupling
