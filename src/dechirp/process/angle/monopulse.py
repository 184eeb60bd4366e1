"""Phase monopulse: the angle from the phase between elements that stand side by side."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.angle import likelihood
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.bartlett import beam_power
from dechirp.process.angle.base import Angles, DirectionEstimator
from dechirp.theory import direction_bounds

# Pairs count as displaced alike within so many wavelengths: 0.4 degrees of phase.
_ALIKE = 1e-3
# Elements nearer than this count as at one place.
_APART = 0.01


class Displaced(NamedTuple):
    """Pairs of elements that differ by the same displacement."""

    by: np.ndarray
    """(2,), along y and z, in wavelengths."""
    first: np.ndarray
    """(n_pairs,) elements."""
    second: np.ndarray
    """(n_pairs,) elements that far from them."""


@value
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
    of one depth (x) are displaced along the angles that it tells.

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
                got=self.n_sources,
                need="1: a phase is one angle",
                fix="Take another kind for several sources, such as maximum-likelihood.",
            )

    def angles(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Angles:
        """The angles of the phases, on that of their branches to which the array agrees."""
        chosen = displaced(aperture)
        phases = np.stack(
            [
                np.angle(
                    np.sum(snapshots[..., p.first].conj() * snapshots[..., p.second], axis=(1, 2))
                )
                for p in chosen
            ],
            axis=-1,
        )
        branches = _branches(aperture)
        to_cosines = np.linalg.inv(_by(aperture)) / (-2 * np.pi)
        cosines = (phases[:, None] + 2 * np.pi * branches) @ to_cosines.T
        limits = np.array(aperture.field_of_view.sines)
        sines = np.zeros((*cosines.shape[:2], 2))
        sines[..., list(aperture.tells)] = cosines
        beyond = np.any(np.abs(sines) > limits, axis=-1)
        sines[..., 1] = np.clip(sines[..., 1], -limits[1], limits[1])
        sines[..., 0] /= np.sqrt(1 - sines[..., 1] ** 2)
        beyond |= np.abs(sines[..., 0]) > limits[0]
        sines[..., 0] = np.clip(sines[..., 0], -limits[0], limits[0])
        azimuth, elevation = np.moveaxis(np.arcsin(sines), -1, 0)
        best = np.zeros((len(snapshots), 1), int)
        if len(branches) > 1:
            power = beam_power(snapshots, aperture.steering(azimuth, elevation))
            # Two elements agree to all: the first branch then. Clipped ones come last.
            power *= np.where(beyond, 1e-6, 1 - 1e-5 * np.arange(len(branches)))
            best = np.argmax(power, axis=1)[:, None]
        return np.take_along_axis(azimuth, best, 1), np.take_along_axis(elevation, best, 1)

    def standard_errors(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray, angles: Angles
    ) -> np.ndarray:
        """Those of the phases, to first order, and through the arc sine those of the angles."""
        told = np.flatnonzero(aperture.tells)
        chosen = displaced(aperture)
        to_cosines = np.linalg.inv(_by(aperture)) / (2 * np.pi)
        weights = np.zeros((len(chosen), aperture.n_elements))
        for row, pairs in zip(weights, chosen, strict=True):
            np.add.at(row, pairs.second, 1 / len(pairs.second))
            np.add.at(row, pairs.first, -1 / len(pairs.first))
        # Of phases, at a ratio of 1/2 in an element: that is where its own has a variance of 1.
        of_cosines = to_cosines @ (weights @ weights.T) @ to_cosines.T
        slopes = direction_bounds.slopes(*angles)[:, 0][:, told][:, :, told + 1]
        to_angles = np.swapaxes(np.linalg.inv(slopes), 1, 2)
        of_angles = to_angles @ of_cosines @ np.swapaxes(to_angles, 1, 2)
        with np.errstate(divide="ignore"):
            snr = likelihood.powers(snapshots, aperture, *angles)[:, 0] / noise_power
            variance = np.diagonal(of_angles, axis1=1, axis2=2) / (
                2 * snapshots.shape[1] * snr[:, None]
            )
        return np.sqrt(variance)[:, None]


@lru_cache(maxsize=8)
def displaced(aperture: Aperture) -> tuple[Displaced, ...]:
    """The pairs whose phases are taken, a set for each angle that the array tells.

    Raises `InvalidSetting` where there are none.
    """
    first, second = np.triu_indices(aperture.n_elements, 1)
    by = aperture.positions[second] - aperture.positions[first]
    level = np.abs(by[:, 0]) < _ALIKE
    first, second, by = first[level], second[level], by[level, 1:]
    # From right to left, or from below where neither is to the left.
    backward = np.where(np.abs(by[:, 0]) > _ALIKE, by[:, 0] < 0, by[:, 1] < 0)
    first, second = np.where(backward, second, first), np.where(backward, first, second)
    by[backward] *= -1
    if all(aperture.tells):
        one = _widest(by, np.ones(len(by), bool))
        across = np.abs(by @ [-one[1], one[0]]) >= np.abs(by @ one)
        chosen = [one, _widest(by, across)]
    else:
        axis = int(aperture.tells[1])
        chosen = [_widest(by, np.abs(by[:, axis]) >= np.abs(by[:, 1 - axis]))]
    sets = []
    for displacement in chosen:
        alike = np.all(np.abs(by - displacement) < _ALIKE, axis=1)
        sets.append(Displaced(by[alike].mean(axis=0), first[alike], second[alike]))
    return tuple(sets)


def _by(aperture: Aperture) -> np.ndarray:
    """Displacements along the axes that the array tells, a row for each set of pairs."""
    return np.array([pairs.by for pairs in displaced(aperture)])[:, list(aperture.tells)]


def _branches(aperture: Aperture) -> np.ndarray:
    """Whole turns that the phases may lack within the field of view, (n, n_told), fewest first."""
    most = (
        2
        * np.pi
        * np.abs(_by(aperture))
        @ np.array(aperture.field_of_view.sines)[list(aperture.tells)]
    )
    each = [np.arange(-k, k + 1) for k in np.ceil((most - np.pi) / (2 * np.pi) - 1e-3).astype(int)]
    turns = np.stack(np.meshgrid(*each, indexing="ij"), axis=-1).reshape(-1, len(each))
    return np.asarray(turns[np.argsort(np.abs(turns).sum(axis=1), kind="stable")])


def _widest(by: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """The longest of the allowed displacements within half a wavelength, or else the shortest.

    Of equal ones that of most pairs.
    """
    length = np.hypot(*by.T)
    allowed &= length > _APART
    if not allowed.any():
        raise InvalidSetting(
            "Chain.angle",
            got="monopulse, for an array without two elements side by side at one depth",
            need="pairs of elements displaced along each angle that is sought",
            fix="Take kind bartlett, which needs no pairs.",
        )
    within = allowed & (length < 0.5 + _ALIKE)
    chosen = length[within].max() if within.any() else length[allowed].min()
    candidates = by[allowed & (np.abs(length - chosen) < _ALIKE)]
    alike = np.all(np.abs(candidates[:, None] - candidates) < _ALIKE, axis=2)
    return np.asarray(candidates[np.argmax(alike.sum(axis=1))])
