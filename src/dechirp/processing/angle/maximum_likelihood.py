"""Maximum likelihood of one or two sources, of unknown amplitude each, on any array.

The best amplitudes for given directions are those of least squares, so the power of the snapshots
within the span of the steering vectors remains to be maximised. The search starts from the second
source beside the strongest (I. Ziskind and M. Wax, IEEE Trans. ASSP 36(10), 1988) and from the
best pair within a beam; the higher maximum wins. For one source it is the peak of the Bartlett
spectrum.
"""

import numpy as np

from dechirp.core.checks import check_non_negative_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle import likelihood, model_order
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.base import Angles, DirectionEstimator
from dechirp.processing.angle.second_source_test import exceeds_channel_errors_mask

# Candidate offsets of pairs from the strongest direction, in beams, 1 / length in sines: 36 pairs
# on one axis, 300 on two.
_PAIR_OFFSETS = {1: np.linspace(-1.1, 1.1, 9), 2: np.linspace(-1.0, 1.0, 5)}
# Largest share of the second source's power in the beam of the first one.
_MAX_OVERLAP = 0.8
# Complex numbers in a block of detections: 32 MB.
_MAX_BLOCK_VALUES = 2**21


@frozen_dataclass
class MaximumLikelihood(DirectionEstimator):
    """Directions that explain most of the snapshots: deterministic maximum likelihood.

    It finds one or two sources, coherent or not, on arrays of any shape. `mdl` and `aic` choose
    between one and two by the power that the second explains, see
    `model_order.significant_second_source_mask`. With a phase of the channels, only power that
    errors of the channels do not explain counts, see `second_source_test`.
    """

    channel_phase_rad: float = 0.0
    """Standard deviation of the phase errors of antennas; 16 degrees without calibration."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_non_negative_fields(self, "channel_phase_rad", at_most=1.0)
        if isinstance(self.n_sources, int) and self.n_sources > 2:
            raise InvalidSetting(
                "MaximumLikelihood.n_sources",
                value=self.n_sources,
                expected="1 or 2, or mdl or aic to choose between them",
                fix="use iterative-adaptive, or esprit on a uniform line, for more",
            )

    def find_angles(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> Angles:
        """Find the most likely direction, or pair of directions, of each detection."""
        is_single = self.n_sources == 1 or not self._can_resolve_two_sources(
            snapshots.shape[1], aperture
        )
        angles = np.full((2, len(snapshots), 1 if is_single else 2), np.nan)
        n_pairs = len(_PAIR_OFFSETS[sum(aperture.resolves_azimuth_and_elevation)]) ** (
            2 * sum(aperture.resolves_azimuth_and_elevation)
        )
        largest = max(len(aperture.direction_grid.steering), n_pairs, 25 * aperture.n_elements)
        block_size = max(1, _MAX_BLOCK_VALUES // (snapshots.shape[1] * largest))
        for start in range(0, len(snapshots), block_size):
            rows = slice(start, start + block_size)
            x = snapshots[rows].astype(np.complex128)
            single_source = likelihood.maximise_direction_likelihood(
                x, aperture, *_strongest_grid_direction(x, aperture)
            )
            if is_single:
                angles[:, rows] = single_source
                continue
            pair, gain = _most_likely_pair_and_power_gain(x, single_source, aperture)
            if not isinstance(self.n_sources, int):
                has_one_source = ~self._second_source_mask(
                    x, single_source, pair, gain, noise_power[rows], aperture
                )
                for angle, strongest in zip(pair, single_source, strict=True):
                    angle[has_one_source, 0], angle[has_one_source, 1] = (
                        strongest[has_one_source, 0],
                        np.nan,
                    )
            angles[:, rows] = pair
        return angles[0], angles[1]

    def _second_source_mask(
        self,
        snapshots: np.ndarray,
        single_source: Angles,
        pair: Angles,
        power_gain: np.ndarray,
        noise_power: np.ndarray,
        aperture: Aperture,
    ) -> np.ndarray:
        """Return True where the second source of a pair is significant, (n,)."""
        assert not isinstance(self.n_sources, int)
        is_significant = model_order.significant_second_source_mask(
            power_gain,
            noise_power,
            snapshots.shape,
            sum(aperture.resolves_azimuth_and_elevation),
            self.n_sources,
        )
        rows = np.flatnonzero(is_significant)
        if self.channel_phase_rad > 0 and rows.size:
            is_significant[rows] = exceeds_channel_errors_mask(
                snapshots[rows],
                (single_source[0][rows], single_source[1][rows]),
                (pair[0][rows], pair[1][rows]),
                aperture,
                noise_power[rows],
                self.channel_phase_rad,
            )
        return is_significant

    def _can_resolve_two_sources(self, n_snapshots: int, aperture: Aperture) -> bool:
        """Return True if two sources have fewer unknowns than the snapshots have values."""
        n_angles = sum(aperture.resolves_azimuth_and_elevation)
        min_elements = int(2 + n_angles / n_snapshots) + 1
        if self.n_sources == 2 and aperture.n_elements < min_elements:
            raise InvalidSetting(
                "MaximumLikelihood.n_sources",
                value=f"2 at {aperture.n_elements} virtual elements",
                expected=f"1, or {min_elements} elements or more: since any two directions"
                " explain fewer",
                fix="set n_sources to 1, or use an array with more elements",
            )
        return aperture.n_elements >= min_elements


def _most_likely_pair_and_power_gain(
    snapshots: np.ndarray, single_source: Angles, aperture: Aperture
) -> tuple[Angles, np.ndarray]:
    """Return the most likely pairs, (n, 2) each, and their power beyond one source, (n,)."""
    searched_pair, near_pair = (
        likelihood.maximise_direction_likelihood(snapshots, aperture, *start)
        for start in (
            _pair_with_best_grid_partner(snapshots, single_source, aperture),
            _best_pair_within_beam(snapshots, single_source, aperture),
        )
    )
    by_search, by_pair = (
        _explained_power(snapshots, aperture, searched_pair),
        _explained_power(snapshots, aperture, near_pair),
    )
    use_near_pair = (by_pair > by_search)[:, None]
    azimuth, elevation = (
        np.where(use_near_pair, b, a) for a, b in zip(searched_pair, near_pair, strict=True)
    )
    gain = np.maximum(by_search, by_pair) - _explained_power(snapshots, aperture, single_source)
    return (azimuth, elevation), gain


def _explained_power(snapshots: np.ndarray, aperture: Aperture, angles: Angles) -> np.ndarray:
    """Return the power of the snapshots within the span of the steering vectors, (n,)."""
    basis = np.linalg.qr(np.swapaxes(aperture.steering_vectors(*angles), 1, 2))[0]
    return np.sum(np.abs(snapshots @ basis.conj()) ** 2, axis=(1, 2))


def _strongest_grid_direction(snapshots: np.ndarray, aperture: Aperture) -> Angles:
    """Return the direction of the grid that explains most power, (n, 1) each."""
    return _grid_direction_of_maximum(
        np.sum(np.abs(_form_beams_to_grid_directions(snapshots, aperture)) ** 2, axis=1), aperture
    )


def _pair_with_best_grid_partner(
    snapshots: np.ndarray, single_source: Angles, aperture: Aperture
) -> Angles:
    """Return one source, and the grid direction of most power beside it, (n, 2) each."""
    steering = aperture.steering_vectors(*single_source)  # (n, 1, n_elements)
    shared = steering[:, 0].astype(np.complex64) @ aperture.direction_grid.steering.conj().T
    shared /= aperture.n_elements
    own_beams = snapshots @ np.swapaxes(steering, 1, 2).conj()  # (n, n_snapshots, 1)
    power = np.sum(
        np.abs(_form_beams_to_grid_directions(snapshots, aperture) - own_beams * shared[:, None])
        ** 2,
        axis=1,
    )
    remaining = 1 - np.abs(shared) ** 2
    power = np.where(
        remaining > 1 - _MAX_OVERLAP, power / np.maximum(remaining, 1 - _MAX_OVERLAP), -1
    )
    other = _grid_direction_of_maximum(power, aperture)
    azimuth, elevation = (
        np.concatenate(both, axis=1) for both in zip(single_source, other, strict=True)
    )
    return azimuth, elevation


def _best_pair_within_beam(
    snapshots: np.ndarray, single_source: Angles, aperture: Aperture
) -> Angles:
    """Return the best of the pairs about one source, (n, 2) each."""
    lengths = np.ptp(aperture.positions[:, 1:], axis=0)
    offsets = np.meshgrid(
        *(
            _PAIR_OFFSETS[sum(aperture.resolves_azimuth_and_elevation)] / length
            if is_resolved
            else np.zeros(1)
            for is_resolved, length in zip(
                aperture.resolves_azimuth_and_elevation, lengths, strict=True
            )
        )
    )
    candidates = [
        np.arcsin(np.clip(np.sin(angle) + offset.ravel(), -limit, limit))
        for angle, offset, limit in zip(
            single_source, offsets, aperture.field_of_view.max_angle_sines, strict=True
        )
    ]
    steering = aperture.steering_vectors(*candidates)  # (n, places, n_elements)
    beams = snapshots @ np.swapaxes(steering, 1, 2).conj()
    shared = steering.conj() @ np.swapaxes(steering, 1, 2) / aperture.n_elements
    first, second = np.triu_indices(steering.shape[1], 1)
    first_beams, second_beams, overlap = (
        beams[:, :, first],
        beams[:, :, second],
        shared[:, first, second],
    )
    power = np.abs(first_beams) ** 2 + np.abs(second_beams) ** 2
    power -= 2 * np.real(first_beams.conj() * second_beams * overlap[:, None])
    # At the edges of the field of view candidates coincide.
    remaining = 1 - np.abs(overlap) ** 2
    power = np.where(remaining > 1e-3, power.sum(axis=1) / np.maximum(remaining, 1e-3), -1)
    best, rows = np.argmax(power, axis=1), np.arange(len(snapshots))
    azimuth, elevation = (
        np.stack([candidate[rows, first[best]], candidate[rows, second[best]]], axis=1)
        for candidate in candidates
    )
    return azimuth, elevation


def _form_beams_to_grid_directions(snapshots: np.ndarray, aperture: Aperture) -> np.ndarray:
    """Return beams matched to each direction of the grid, (n, n_snapshots, n_directions)."""
    # One product of matrices: as a stack of single rows it takes seven times as long.
    rows = snapshots.reshape(-1, snapshots.shape[-1]).astype(np.complex64)
    beams = rows @ aperture.direction_grid.steering.conj().T
    return beams.reshape(*snapshots.shape[:-1], beams.shape[-1])


def _grid_direction_of_maximum(power: np.ndarray, aperture: Aperture) -> Angles:
    """Return the direction of the greatest power (n, n_directions), (n, 1) each."""
    grid = aperture.direction_grid
    row, column = np.divmod(np.argmax(power, axis=1), grid.shape[1])
    return grid.azimuth_rad[column][:, None], grid.elevation_rad[row][:, None]
