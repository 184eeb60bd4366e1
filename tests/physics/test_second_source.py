"""Second sources in a detection, told from errors of the channels of an array."""

import numpy as np
import pytest
from test_angle_motion_compensation import make_mimo_radar, make_target

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.fft import Fft
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.chain import Chain
from dechirp.processing.chain_fitting import fit_chain_to_frames
from dechirp.processing.detect import detect
from nightly import nightly

PHASE_RAD = float(np.radians(20))
TOLERANT = MaximumLikelihood(n_sources="mdl", channel_phase_rad=PHASE_RAD)
NOISE = 1e-4
"""Noise power of an element, 40 dB below a source."""


def make_line(n_elements, n_transmitters):
    positions = np.arange(n_elements)[:, None] * [0.0, 0.5, 0.0]
    return Aperture(positions, n_transmitters=n_transmitters)


def make_snapshots(aperture, azimuth_rad, phase_deg, rng, *, clutter=0.0, second=0.0, step=0.0):
    """Return snapshots (n, 1, n_elements) of sources with errors of channels, and second azimuths.

    The gains of antennas differ by 0.5 dB. Amplitudes of `clutter` and of a `second` source at a
    sine greater by `step`, relative to the first source.
    """
    n, n_antennas = len(azimuth_rad), aperture.antenna_indicators.shape[1]
    other_rad = np.arcsin(np.sin(azimuth_rad) + step)
    turns = np.exp(2j * np.pi * rng.uniform(size=(n, 1)))
    echoes = aperture.steering_vectors(azimuth_rad)
    echoes = echoes + second * turns * aperture.steering_vectors(other_rad)
    phases, gains = rng.normal(size=(2, n, n_antennas)) * [[[np.radians(phase_deg)]], [[0.058]]]
    echoes = echoes * np.exp((gains + 1j * phases) @ aperture.antenna_indicators.T)
    noise = rng.normal(size=(*echoes.shape, 2)) @ [1, 1j] * np.sqrt((clutter**2 + NOISE) / 2)
    return (echoes + noise)[:, None], other_rad


def second_source_share(estimator, snapshots, aperture):
    directions = estimator.find_directions(snapshots, aperture, np.full(len(snapshots), NOISE))
    azimuth_rad = directions.azimuth_rad
    return np.mean(np.isfinite(azimuth_rad[:, 1])) if azimuth_rad.shape[1] > 1 else 0.0


@nightly
@pytest.mark.parametrize("n_elements, n_transmitters", [(8, 1), (8, 2), (12, 3)])
def test_channels_of_a_single_source_are_no_second_one(n_elements, n_transmitters):
    aperture, rng = make_line(n_elements, n_transmitters), np.random.default_rng(1)
    for phase_deg in (10, 13, 16):
        azimuth_rad = rng.uniform(-1, 1, 1500)
        snapshots, _ = make_snapshots(aperture, azimuth_rad, phase_deg, rng)

        # 8 of 1,500 at a rate of 0.1 % are less likely than 1e-4, and the stated bound is 3e-5.
        assert second_source_share(TOLERANT, snapshots, aperture) <= 8 / 1500
        noise_alone = MaximumLikelihood(n_sources="mdl")
        assert second_source_share(noise_alone, snapshots[:100], aperture) > 0.9


@nightly
@pytest.mark.parametrize("clutter_db, largest_share", [(-20, 0.001), (-10, 0.01)])
def test_clutter_beside_a_single_source_is_no_second_one(clutter_db, largest_share):
    aperture, rng = make_line(8, 2), np.random.default_rng(2)
    azimuth_rad = rng.uniform(-1, 1, 3000)
    clutter = 10 ** (clutter_db / 20)
    snapshots, _ = make_snapshots(aperture, azimuth_rad, 5, rng, clutter=clutter)

    margin = 5 * np.sqrt(largest_share / len(azimuth_rad))
    assert second_source_share(TOLERANT, snapshots, aperture) < largest_share + margin


@pytest.mark.parametrize("n_elements, n_transmitters", [(8, 2), (12, 3), (16, 4)])
def test_second_source_10_db_weaker_is_found_in_spite_of_channels(n_elements, n_transmitters):
    aperture, rng = make_line(n_elements, n_transmitters), np.random.default_rng(3)
    azimuth_rad = rng.uniform(-0.8, 0.3, 300)
    snapshots, other_rad = make_snapshots(
        aperture, azimuth_rad, 10, rng, second=10**-0.5, step=2.4 / n_elements
    )

    found = TOLERANT.find_directions(snapshots, aperture, np.full(300, NOISE)).azimuth_rad

    is_pair = np.isfinite(found[:, 1])
    assert is_pair.mean() > 0.9
    # The null-to-null width is 4 / n in sines; phases of 10 degrees move a source of 0.3 by less
    # than a third of the half width.
    errors = np.sin(np.sort(found[is_pair], axis=1))
    errors -= np.sin(np.stack([azimuth_rad, other_rad], axis=1)[is_pair])
    assert np.median(abs(errors), axis=0).max() < 0.7 / n_elements


def test_exact_fits_and_empty_snapshots_have_one_source_at_most():
    aperture = make_line(8, 2)
    snapshots = np.zeros((2, 1, 8), complex)
    snapshots[1, 0] = aperture.steering_vectors(0.3)

    found = TOLERANT.find_directions(snapshots, aperture, np.zeros(2)).azimuth_rad

    assert np.isfinite(found).sum(axis=1).tolist() == [0, 1]


def simulate_reflectors(radar, azimuths_deg, seed):
    """Simulate reflectors at 20 m, received by channels with phases of 12 degrees."""
    mismatch = dc.impairments.ChannelMismatch(phase_std_rad=np.radians(12), gain_std=1.122)
    scene = dc.Scene(targets=[make_target(azimuth, 0.0) for azimuth in azimuths_deg])
    impairments = (mismatch, dc.impairments.ThermalNoise())
    return dc.simulate(scene, radar, impairments=impairments, seed=seed)


def fit(cube, radar):
    return fit_chain_to_frames(Chain(), radar, [cube.values[0]])


@pytest.mark.parametrize("seed", range(3))
def test_fitted_chain_shows_both_reflectors_of_a_cell(radar, seed):
    radar = make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))
    cube = simulate_reflectors(radar, (-10, 10), seed)
    assert detect(cube, radar).sizes["detection"] == 1

    chain, choices = fit(cube, radar)

    assert chain.angle == TOLERANT
    (choice,) = (choice for choice in choices if choice.setting == "chain.angle")
    assert choice.options == (
        "chain.angle.kind=maximum-likelihood",
        "chain.angle.n_sources=mdl",
        "chain.angle.channel_phase=20 deg",
    )
    detections = detect(cube, radar, chain).sortby("azimuth")
    deviation = detections.azimuth.values - np.radians([-10, 10])
    # Phases of the transmitters are exact here, those of receivers have 12 degrees.
    assert np.all(abs(deviation) < 4 * detections.azimuth_std.values)
    assert np.all(detections.azimuth_std.values < np.radians(5))


@pytest.mark.parametrize("seed", range(3))
def test_fitted_chain_keeps_one_direction_of_a_single_reflector(radar, seed):
    radar = make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))
    cube = simulate_reflectors(radar, (10,), seed)

    chain, choices = fit(cube, radar)

    assert chain.angle == Fft()
    assert "chain.angle" not in [choice.setting for choice in choices]


def test_given_estimators_stay(radar):
    radar = make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))
    cube = simulate_reflectors(radar, (-10, 10), 0)

    given = fit_chain_to_frames(Chain(angle=TOLERANT), radar, [cube.values[0]])[0]
    kept = fit_chain_to_frames(Chain(), radar, [cube.values[0]], kept=("angle",))[0]

    assert given.angle == TOLERANT
    assert kept.angle == Fft()


def test_transmitters_divide_the_elements():
    with pytest.raises(dc.InvalidSetting, match="a divisor of 8"):
        make_line(8, 3)
    with pytest.raises(dc.InvalidSetting, match="channel_phase_rad"):
        MaximumLikelihood(channel_phase_rad=-0.1)
