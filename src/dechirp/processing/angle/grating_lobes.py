"""Grating lobes: ambiguous directions of arrays with wide spacing."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.processing.angle.aperture import Aperture

# Amplitude correlation of steering vectors from which two directions are ambiguous: the second
# explains all but a tenth of the power of the first.
MIN_CORRELATION = 0.95
# Ambiguities only beyond this angle are a note.
_SIDEWAYS_RAD = np.pi / 3
# Grating lobes within this margin of the edge of the field of view are not reported: all arrays
# with half a wavelength have theirs at 90 degrees, and 0.1 % wider ones at 87.4.
_EDGE_MARGIN_RAD = np.pi / 60
_MAX_BLOCK_VALUES = 2**22
_NEIGHBOURS = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)


def smallest_grating_lobe_separation(aperture: Aperture) -> tuple[float, float] | None:
    """Return the smallest separation of ambiguous directions, in sines of azimuth and elevation.

    The first grating lobe within the field of view, less three degrees at its edges; None where
    all directions differ. Elements are taken to have equal depth, elevations to be small.
    """
    from scipy.ndimage import maximum_filter  # 0.07 s, of which other commands need nothing

    steps = np.array(aperture.direction_grid_sine_steps) / 2
    field_of_view = aperture.field_of_view
    limits = 2 * np.sin(
        np.array([field_of_view.azimuth_rad, field_of_view.elevation_rad]) - _EDGE_MARGIN_RAD
    )
    axes = [
        step * np.arange(-int(limit / step), int(limit / step) + 1) if step else np.zeros(1)
        for step, limit in zip(steps, limits, strict=True)
    ]
    separations = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    correlation = _steering_vector_correlation(aperture, separations)
    is_maximum = correlation == maximum_filter(correlation, size=3, mode="nearest")
    lobes = separations[
        is_maximum & (correlation > MIN_CORRELATION - 0.1) & np.any(separations != 0, axis=-1)
    ]
    for halving in range(1, 8):
        neighbours = lobes[:, None] + steps / 2.0**halving * _NEIGHBOURS
        best = np.argmax(_steering_vector_correlation(aperture, neighbours), axis=1)
        lobes = neighbours[np.arange(len(lobes)), best]
    lobes = lobes[
        np.all(np.abs(lobes) < limits, axis=1)
        & (_steering_vector_correlation(aperture, lobes) > MIN_CORRELATION)
    ]
    if not len(lobes):
        return None
    azimuth, elevation = np.abs(lobes[np.argmin(np.hypot(*lobes.T))])
    return float(azimuth), float(elevation)


def grating_lobe_findings(aperture: Aperture) -> list[Finding]:
    """Return a finding on ambiguous directions within the field of view, if there are any."""
    separation = smallest_grating_lobe_separation(aperture)
    if separation is None:
        return []
    field_of_view = aperture.field_of_view
    # No two directions within half of each separation to either side of boresight are ambiguous.
    half = np.arcsin(np.minimum(np.array(separation) / 2, 1.0))
    axis = int(separation[1] > separation[0])
    name, limit = (
        ("azimuth", field_of_view.azimuth_rad),
        ("elevation", field_of_view.elevation_rad),
    )[axis]
    limit_deg = np.degrees(half[axis])
    return [
        Finding(
            level="note" if half[axis] > _SIDEWAYS_RAD else "warning",
            setting=f"chain.field_of_view.{name}",
            value=f"{name}s beyond {limit_deg:.3g} deg are ambiguous for this array, such as"
            f" -{limit_deg:.3g} and {limit_deg:.3g} deg",
            expected=f"a field of view of at most {limit_deg:.3g} deg to each side, instead of"
            f" {np.degrees(limit):.4g} deg",
            fix="narrow the field of view to that of the targets, or space elements half a"
            " wavelength apart",
        )
    ]


def _steering_vector_correlation(aperture: Aperture, sine_separations: np.ndarray) -> np.ndarray:
    """Return the correlation of steering vectors over separations (..., 2): (...), 0 to 1."""
    flat = sine_separations.reshape(-1, 2)
    out = np.empty(len(flat))
    block_size = max(1, _MAX_BLOCK_VALUES // aperture.n_elements)
    for first in range(0, len(flat), block_size):
        phase = 2 * np.pi * (flat[first : first + block_size] @ aperture.positions[:, 1:].T)
        out[first : first + block_size] = np.abs(np.mean(np.exp(1j * phase), axis=1))
    return out.reshape(sine_separations.shape[:-1])
