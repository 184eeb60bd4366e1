"""The iterative adaptive approach: one snapshot, coherent sources, any array."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.angle.iterative_adaptive import IterativeAdaptive

LINE = np.stack([np.zeros(12), np.arange(12) / 2, np.zeros(12)], axis=1)
ANYWHERE = np.random.default_rng(101).uniform(0, 3.5, (16, 3)) * [0.05, 1, 1]
BEAM = 0.886 / 6  # of twelve elements, in sines


def noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def two_sources(seen, n, rng):
    middle = rng.uniform(-0.5, 0.5, (n, 1))
    sines = middle + np.array([-BEAM / 2, BEAM / 2])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 2)))
    x = np.einsum("nk,nki->ni", amplitudes, seen.steering_vectors(np.arcsin(sines)))
    return sines, (x + noise(x.shape, rng))[:, None]


def test_it_parts_two_sources_a_beamwidth_apart_at_any_phase_where_beams_do_not():
    seen, n = Aperture(LINE), 400
    sines, x = two_sources(seen, n, np.random.default_rng(102))
    parted = {}
    for kind in (IterativeAdaptive, Bartlett):
        found = kind(n_sources=2).find_directions(x, seen, np.ones(n))
        at = np.sort(np.sin(found.azimuth_rad), axis=1)
        parted[kind] = np.mean(np.all(abs(at - sines) < BEAM / 2, axis=1))
    assert parted[IterativeAdaptive] > 0.95 and parted[Bartlett] < 0.85


def test_its_sidelobes_are_far_below_those_of_beams():
    seen = Aperture(LINE)
    x = 10 * seen.steering_vectors(0.2)[None, None] + noise((1, 1, 12), np.random.default_rng(103))
    beams, adaptive = (
        10 * np.log10(kind().spectrum(x, seen, np.ones(1))[0, 0])
        for kind in (Bartlett, IterativeAdaptive)
    )
    away = abs(np.sin(seen.grid.azimuth_rad) - np.sin(0.2)) > 1 / 6
    # The first sidelobe of twelve elements is 13 dB down.
    assert beams.max() - beams[away].max() < 14
    assert adaptive.max() - adaptive[away].max() > 20


def test_errors_of_two_sources_on_a_sparse_plane_are_as_reported():
    seen, n = Aperture(ANYWHERE), 40
    rng = np.random.default_rng(104)
    azimuth, elevation = np.array([-0.4, 0.3]), np.array([0.1, -0.2])
    amplitudes = 10 * np.exp(2j * np.pi * rng.uniform(size=(n, 1, 2)))
    x = amplitudes @ seen.steering_vectors(azimuth, elevation) + noise((n, 1, 16), rng)
    found = IterativeAdaptive(n_sources=2).find_directions(x, seen, np.ones(n))
    order = np.argsort(found.azimuth_rad, axis=1)
    for truth, at, std in (
        (azimuth, found.azimuth_rad, found.azimuth_std_rad),
        (elevation, found.elevation_rad, found.elevation_std_rad),
    ):
        error = (np.take_along_axis(at, order, 1) - truth) / np.take_along_axis(std, order, 1)
        assert np.all(abs(error) < 6)
        # 80 squared errors: standard error 0.16.
        assert np.mean(error**2) == pytest.approx(1, abs=0.75)


def test_snapshots_without_noise_are_no_trouble():
    seen = Aperture(LINE)
    x = np.stack([seen.steering_vectors(0.2), np.zeros(12)])[:, None]
    found = IterativeAdaptive().find_directions(x, seen, np.zeros(2))
    assert found.azimuth_rad[0, 0] == pytest.approx(0.2, abs=1e-6)
    assert found.azimuth_std_rad[0, 0] < 1e-6


def test_rounds_below_one_are_refused():
    with pytest.raises(dc.InvalidSetting, match="n_iterations"):
        IterativeAdaptive(n_iterations=0)
