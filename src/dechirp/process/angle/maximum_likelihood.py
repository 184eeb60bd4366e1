"""Maximum likelihood of one or two sources, of unknown amplitude each, on any array.

The amplitudes that fit best for given directions are those of least squares, so what is left
to maximise is the power of the snapshots within the span of the steering vectors. Its maxima
are climbed from a search for the second source beside the strongest (I. Ziskind and M. Wax,
IEEE Trans. ASSP 36(10), 1988) and from the best pair within a beam; the higher one is taken.
For one source it is the peak of the Bartlett spectrum.
"""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.angle import likelihood, order
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.base import Angles, DirectionEstimator

# Places in which pairs are looked for about the strongest direction, in beams, 1 / length in
# sines: on one axis 36 pairs, on two 300.
_NEAR = {1: np.linspace(-1.1, 1.1, 9), 2: np.linspace(-1.0, 1.0, 5)}
# The second source of a search shares at most so much of its power with the first one.
_SHARED = 0.8
# Complex numbers in a block of detections: 32 MB.
_BLOCK = 2**21


@value
class MaximumLikelihood(DirectionEstimator):
    """Directions that explain most of the snapshots: deterministic maximum likelihood.

    Finds one or two sources, coherent or not, on arrays of any shape. `mdl` and `aic` choose
    between one and two by what the second explains, see `order.second_source`.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.n_sources, int) and self.n_sources > 2:
            raise InvalidSetting(
                "MaximumLikelihood.n_sources",
                got=self.n_sources,
                need="1 or 2, or mdl or aic to choose between them",
                fix="Take iterative-adaptive, or esprit on a uniform line, for more.",
            )

    def angles(self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray) -> Angles:
        """The most likely direction, or pair of directions, of each snapshot."""
        alone = self.n_sources == 1 or not self._can_part(snapshots.shape[1], aperture)
        found = np.full((2, len(snapshots), 1 if alone else 2), np.nan)
        pairs = len(_NEAR[sum(aperture.tells)]) ** (2 * sum(aperture.tells))
        largest = max(len(aperture.grid.steering), pairs, 25 * aperture.n_elements)
        each = max(1, _BLOCK // (snapshots.shape[1] * largest))
        for start in range(0, len(snapshots), each):
            rows = slice(start, start + each)
            x = snapshots[rows].astype(np.complex128)
            one = likelihood.maximised(x, aperture, *_strongest(x, aperture))
            if alone:
                found[:, rows] = one
                continue
            two, gain = _pair(x, one, aperture)
            if not isinstance(self.n_sources, int):
                single = ~order.second_source(
                    gain, noise_power[rows], x.shape, sum(aperture.tells), self.n_sources
                )
                for angle, strongest in zip(two, one, strict=True):
                    angle[single, 0], angle[single, 1] = strongest[single, 0], np.nan
            found[:, rows] = two
        return found[0], found[1]

    def _can_part(self, n_looks: int, aperture: Aperture) -> bool:
        """Whether two sources have fewer unknowns than the snapshots have numbers."""
        n_told = sum(aperture.tells)
        least = int(2 + n_told / n_looks) + 1
        if self.n_sources == 2 and aperture.n_elements < least:
            raise InvalidSetting(
                "MaximumLikelihood.n_sources",
                got=f"2 at {aperture.n_elements} virtual elements",
                need=f"1, or {least} elements or more: any two directions explain so few",
                fix="Seek one direction, or give the array more elements.",
            )
        return aperture.n_elements >= least


def _pair(x: np.ndarray, one: Angles, aperture: Aperture) -> tuple[Angles, np.ndarray]:
    """The most likely pairs, (n, 2) each, and the power they explain beyond one source, (n,)."""
    searched, near = (
        likelihood.maximised(x, aperture, *start)
        for start in (_searched(x, one, aperture), _near(x, one, aperture))
    )
    by_search, by_pair = _explained(x, aperture, searched), _explained(x, aperture, near)
    nearer = (by_pair > by_search)[:, None]
    azimuth, elevation = (np.where(nearer, b, a) for a, b in zip(searched, near, strict=True))
    gain = np.maximum(by_search, by_pair) - _explained(x, aperture, one)
    return (azimuth, elevation), gain


def _explained(x: np.ndarray, aperture: Aperture, angles: Angles) -> np.ndarray:
    """Power of the snapshots within the span of the steering vectors, (n,)."""
    basis = np.linalg.qr(np.swapaxes(aperture.steering(*angles), 1, 2))[0]
    return np.sum(np.abs(x @ basis.conj()) ** 2, axis=(1, 2))


def _strongest(x: np.ndarray, aperture: Aperture) -> Angles:
    """The direction of the grid that explains most, (n, 1) each."""
    return _of_grid(np.sum(np.abs(_beams(x, aperture)) ** 2, axis=1), aperture)


def _searched(x: np.ndarray, one: Angles, aperture: Aperture) -> Angles:
    """One source, and the direction of the grid that explains most beside it, (n, 2) each."""
    known = aperture.steering(*one)  # (n, 1, n_elements)
    shared = known[:, 0].astype(np.complex64) @ aperture.grid.steering.conj().T
    shared /= aperture.n_elements
    own = x @ np.swapaxes(known, 1, 2).conj()  # (n, n_looks, 1)
    power = np.sum(np.abs(_beams(x, aperture) - own * shared[:, None]) ** 2, axis=1)
    left = 1 - np.abs(shared) ** 2
    power = np.where(left > 1 - _SHARED, power / np.maximum(left, 1 - _SHARED), -1)
    other = _of_grid(power, aperture)
    azimuth, elevation = (np.concatenate(both, axis=1) for both in zip(one, other, strict=True))
    return azimuth, elevation


def _near(x: np.ndarray, one: Angles, aperture: Aperture) -> Angles:
    """The best of the pairs about one source, (n, 2) each."""
    lengths = np.ptp(aperture.positions[:, 1:], axis=0)
    offsets = np.meshgrid(
        *(
            _NEAR[sum(aperture.tells)] / length if told else np.zeros(1)
            for told, length in zip(aperture.tells, lengths, strict=True)
        )
    )
    places = [
        np.arcsin(np.clip(np.sin(angle) + offset.ravel(), -limit, limit))
        for angle, offset, limit in zip(one, offsets, aperture.field_of_view.sines, strict=True)
    ]
    steering = aperture.steering(*places)  # (n, places, n_elements)
    beams = x @ np.swapaxes(steering, 1, 2).conj()
    shared = steering.conj() @ np.swapaxes(steering, 1, 2) / aperture.n_elements
    first, second = np.triu_indices(steering.shape[1], 1)
    own, other, between = beams[:, :, first], beams[:, :, second], shared[:, first, second]
    power = np.abs(own) ** 2 + np.abs(other) ** 2
    power -= 2 * np.real(own.conj() * other * between[:, None])
    # At the sides of the field of view places coincide.
    left = 1 - np.abs(between) ** 2
    power = np.where(left > 1e-3, power.sum(axis=1) / np.maximum(left, 1e-3), -1)
    best, rows = np.argmax(power, axis=1), np.arange(len(x))
    azimuth, elevation = (
        np.stack([place[rows, first[best]], place[rows, second[best]]], axis=1) for place in places
    )
    return azimuth, elevation


def _beams(x: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Matched to each direction of the grid, (n, n_looks, n_directions)."""
    return x.astype(np.complex64) @ aperture.grid.steering.conj().T


def _of_grid(power: np.ndarray, aperture: Aperture) -> Angles:
    """Direction of the greatest power (n, n_directions), (n, 1) each."""
    grid = aperture.grid
    row, column = np.divmod(np.argmax(power, axis=1), grid.shape[1])
    return grid.azimuth_rad[column][:, None], grid.elevation_rad[row][:, None]
