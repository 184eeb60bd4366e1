"""Phase monopulse: the angle from the phase between displaced elements."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import likelihood
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum
from dechirp.processing.angle.base import Angles, DirectionEstimator
from dechirp.theory import direction_bounds

# Tolerance of equal displacements in wavelengths: 0.4 degrees of phase.
_TOLERANCE = 1e-3
# Elements closer than this count as coincident.
_MIN_SEPARATION = 0.01


class DisplacedPairs(NamedTuple):
    """Pairs of elements with the same displacement."""

    displacement: np.ndarray
    """Displacement (2,) along y and z, in wavelengths."""
    first: np.ndarray
    """First element of each pair, (n_pairs,)."""
    second: np.ndarray
    """Second element of each pair, (n_pairs,)."""


@frozen_dataclass
class Monopulse(DirectionEstimator):
    r"""One source from the phase between displaced elements.

    .. math:: \theta = \arcsin \frac{\lambda \Delta\varphi}{2 \pi d}

    with d the longest displacement of two elements within half a wavelength, or else the
    shortest, and the phase that of the sum of conj(x_i) x_j over all pairs displaced by it: two
    overlapping parts of the array. Two elements alone make one pair. A planar array has a
    second displacement, at least 45 degrees askew to the first, and both cosines follow from
    the two phases. Beyond half a wavelength a phase has several angles: of those the one is
    taken towards which the beam of the whole array is strongest.

    Noise of an element that stands first in one pair and second in another cancels, so that N
    elements on an even line are as good as the two at its ends, (N - 1) d apart, would be
    without their ambiguity; the bound on all of them is smaller, by sqrt(6 (N - 1) / N (N + 1))
    (2.3 dB of variance for 8).

    Raises `InvalidSetting` for more than one source, and for an array in which no two elements
    of one depth (x) are displaced along an angle that it resolves.

    References
    ----------
    S. M. Sherman and D. K. Barton, Monopulse Principles and Techniques, 2011. S. Kay, A fast
    and accurate single frequency estimator, IEEE Trans. ASSP 37(12), 1989, on the variance.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.n_sources != 1:
            raise InvalidSetting(
                "Monopulse.n_sources",
                value=self.n_sources,
                expected="1, since a phase gives one angle",
                fix="use another kind for several sources, such as maximum-likelihood",
            )

    def find_angles(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Angles:
        """Find the angles of the phases on the most likely branch."""
        pair_sets = displaced_element_pairs_per_angle(aperture)
        phases = np.stack(
            [
                np.angle(
                    np.sum(
                        snapshots[..., pairs.first].conj() * snapshots[..., pairs.second],
                        axis=(1, 2),
                    )
                )
                for pairs in pair_sets
            ],
            axis=-1,
        )
        branches = _phase_ambiguity_cycles(aperture)
        to_cosines = np.linalg.inv(_pair_displacements(aperture)) / (-2 * np.pi)
        cosines = (phases[:, None] + 2 * np.pi * branches) @ to_cosines.T
        limits = np.array(aperture.field_of_view.max_angle_sines)
        sines = np.zeros((*cosines.shape[:2], 2))
        sines[..., list(aperture.resolves_azimuth_and_elevation)] = cosines
        is_outside = np.any(np.abs(sines) > limits, axis=-1)
        sines[..., 1] = np.clip(sines[..., 1], -limits[1], limits[1])
        sines[..., 0] /= np.sqrt(1 - sines[..., 1] ** 2)
        is_outside |= np.abs(sines[..., 0]) > limits[0]
        sines[..., 0] = np.clip(sines[..., 0], -limits[0], limits[0])
        azimuth, elevation = np.moveaxis(np.arcsin(sines), -1, 0)
        best = np.zeros((len(snapshots), 1), int)
        if len(branches) > 1:
            power = bartlett_spectrum(snapshots, aperture.steering_vectors(azimuth, elevation))
            # For two elements all branches fit equally: the first wins. Clipped ones come last.
            power *= np.where(is_outside, 1e-6, 1 - 1e-5 * np.arange(len(branches)))
            best = np.argmax(power, axis=1)[:, None]
        return np.take_along_axis(azimuth, best, 1), np.take_along_axis(elevation, best, 1)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        r"""Return standard errors from the phase noise to second order, through the arc sine.

        To first order in the noise, phases of elements that are first in one pair and second in
        another cancel. The products of two noises do not: for K pairs at the SNR chi they add
        1 / (2 K chi^2) to the variance of a phase, 22 % for eight elements at 12 dB.
        """
        resolved_axes = np.flatnonzero(aperture.resolves_azimuth_and_elevation)
        pair_sets = displaced_element_pairs_per_angle(aperture)
        to_cosines = np.linalg.inv(_pair_displacements(aperture)) / (2 * np.pi)
        weights = np.zeros((len(pair_sets), aperture.n_elements))
        for row, pairs in zip(weights, pair_sets, strict=True):
            np.add.at(row, pairs.second, 1 / len(pairs.second))
            np.add.at(row, pairs.first, -1 / len(pairs.first))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            snr = (
                likelihood.least_squares_source_powers(snapshots, aperture, *angles)[:, 0]
                / noise_power
            )
            squared_noise = 1 / snr[:, None, None]
        # Covariance of phases at an SNR of 1/2 in an element, where its phase variance is 1.
        n_pairs = np.array([len(pairs.first) for pairs in pair_sets])
        phase_covariance = weights @ weights.T + squared_noise * np.diag(1 / n_pairs)
        cosine_covariance = to_cosines @ phase_covariance @ to_cosines.T
        slopes = direction_bounds.unit_vector_derivatives(*angles)[:, 0][:, resolved_axes][
            :, :, resolved_axes + 1
        ]
        to_angles = np.swapaxes(np.linalg.inv(slopes), 1, 2)
        angle_covariance = to_angles @ cosine_covariance @ np.swapaxes(to_angles, 1, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = np.diagonal(angle_covariance, axis1=1, axis2=2) / (
                2 * snapshots.shape[1] * snr[:, None]
            )
        return np.sqrt(variance)[:, None]


@lru_cache(maxsize=8)
def displaced_element_pairs_per_angle(aperture: Aperture) -> tuple[DisplacedPairs, ...]:
    """Return the pairs whose phases are evaluated, a set for each resolved angle.

    Raises `InvalidSetting` where there are none.
    """
    first, second = np.triu_indices(aperture.n_elements, 1)
    displacements = aperture.positions[second] - aperture.positions[first]
    has_equal_depth = np.abs(displacements[:, 0]) < _TOLERANCE
    first, second, displacements = (
        first[has_equal_depth],
        second[has_equal_depth],
        displacements[has_equal_depth, 1:],
    )
    # Order pairs from right to left, or from below where neither is to the left.
    backward = np.where(
        np.abs(displacements[:, 0]) > _TOLERANCE, displacements[:, 0] < 0, displacements[:, 1] < 0
    )
    first, second = np.where(backward, second, first), np.where(backward, first, second)
    displacements[backward] *= -1
    if all(aperture.resolves_azimuth_and_elevation):
        widest = _longest_unambiguous_displacement(displacements, np.ones(len(displacements), bool))
        across = np.abs(displacements @ [-widest[1], widest[0]]) >= np.abs(displacements @ widest)
        displacements_used = [widest, _longest_unambiguous_displacement(displacements, across)]
    else:
        axis = int(aperture.resolves_azimuth_and_elevation[1])
        displacements_used = [
            _longest_unambiguous_displacement(
                displacements, np.abs(displacements[:, axis]) >= np.abs(displacements[:, 1 - axis])
            )
        ]
    sets = []
    for displacement in displacements_used:
        is_equal = np.all(np.abs(displacements - displacement) < _TOLERANCE, axis=1)
        sets.append(
            DisplacedPairs(displacements[is_equal].mean(axis=0), first[is_equal], second[is_equal])
        )
    return tuple(sets)


def _pair_displacements(aperture: Aperture) -> np.ndarray:
    """Return the displacements along the resolved axes, a row for each set of pairs."""
    return np.array([pairs.displacement for pairs in displaced_element_pairs_per_angle(aperture)])[
        :, list(aperture.resolves_azimuth_and_elevation)
    ]


def _phase_ambiguity_cycles(aperture: Aperture) -> np.ndarray:
    """Return the cycles to add to the phases in the field of view, (n, n_angles), fewest first."""
    max_phase = (
        2
        * np.pi
        * np.abs(_pair_displacements(aperture))
        @ np.array(aperture.field_of_view.max_angle_sines)[
            list(aperture.resolves_azimuth_and_elevation)
        ]
    )
    ranges = [
        np.arange(-k, k + 1) for k in np.ceil((max_phase - np.pi) / (2 * np.pi) - 1e-3).astype(int)
    ]
    turns = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(ranges))
    return np.asarray(turns[np.argsort(np.abs(turns).sum(axis=1), kind="stable")])


def _longest_unambiguous_displacement(
    displacements: np.ndarray, is_allowed: np.ndarray
) -> np.ndarray:
    """Return the longest allowed displacement within half a wavelength, or the shortest one.

    Among equal ones that of most pairs.
    """
    length = np.hypot(*displacements.T)
    is_allowed &= length > _MIN_SEPARATION
    if not is_allowed.any():
        raise InvalidSetting(
            "Chain.angle",
            value="monopulse, for an array without two displaced elements at one depth",
            expected="pairs of elements displaced along each angle to estimate",
            fix="use kind bartlett, which needs no pairs",
        )
    is_unambiguous = is_allowed & (length < 0.5 + _TOLERANCE)
    chosen_length = (
        length[is_unambiguous].max() if is_unambiguous.any() else length[is_allowed].min()
    )
    candidates = displacements[is_allowed & (np.abs(length - chosen_length) < _TOLERANCE)]
    is_equal = np.all(np.abs(candidates[:, None] - candidates) < _TOLERANCE, axis=2)
    return np.asarray(candidates[np.argmax(is_equal.sum(axis=1))])
