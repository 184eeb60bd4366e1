"""Directions that look alike: grating lobes of arrays with wide steps."""

import numpy as np
from scipy.ndimage import maximum_filter

from dechirp.core.findings import Finding
from dechirp.process.angle.aperture import Aperture

# Two directions whose steering vectors have this correlation, in amplitude, can hardly be told
# apart: the second explains all but a tenth of the power of the first.
ALIKE = 0.95
# From this far out to the sides it is a note: few look there.
_SIDEWAYS_RAD = np.pi / 3
# Repeats that begin less than this short of the edge of the field of view are not told: all
# arrays at half a wavelength have theirs at 90 degrees, and 0.1 % wider ones at 87.4.
_AT_EDGE_RAD = np.pi / 60
_MOST_NUMBERS = 2**22
_AROUND = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)


def repeats(aperture: Aperture) -> tuple[float, float] | None:
    """Least difference, in the sines of azimuth and elevation, of directions that look alike.

    Of those that the field of view holds, less three degrees at its edges: the first grating lobe.
    None where all directions differ. Elements are taken as at one depth, elevations as small.
    """
    steps = np.array(aperture.steps) / 2
    field = aperture.field_of_view
    most = 2 * np.sin(np.array([field.azimuth_rad, field.elevation_rad]) - _AT_EDGE_RAD)
    axes = [
        step * np.arange(-int(reach / step), int(reach / step) + 1) if step else np.zeros(1)
        for step, reach in zip(steps, most, strict=True)
    ]
    apart = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    likeness = _likeness(aperture, apart)
    tops = likeness == maximum_filter(likeness, size=3, mode="nearest")
    lobes = apart[tops & (likeness > ALIKE - 0.1) & np.any(apart != 0, axis=-1)]
    for halving in range(1, 8):
        around = lobes[:, None] + steps / 2.0**halving * _AROUND
        best = np.argmax(_likeness(aperture, around), axis=1)
        lobes = around[np.arange(len(lobes)), best]
    lobes = lobes[np.all(np.abs(lobes) < most, axis=1) & (_likeness(aperture, lobes) > ALIKE)]
    if not len(lobes):
        return None
    left, up = np.abs(lobes[np.argmin(np.hypot(*lobes.T))])
    return float(left), float(up)


def remark(aperture: Aperture) -> list[Finding]:
    """A finding on directions that repeat within the field of view, if any do."""
    found = repeats(aperture)
    if found is None:
        return []
    field = aperture.field_of_view
    # Half of each difference to either side of boresight: within, no two are that far apart.
    half = np.arcsin(np.minimum(np.array(found) / 2, 1.0))
    axis = int(found[1] > found[0])
    name, limit = (("azimuth", field.azimuth_rad), ("elevation", field.elevation_rad))[axis]
    within = np.degrees(half[axis])
    return [
        Finding(
            level="note" if half[axis] > _SIDEWAYS_RAD else "warning",
            setting=f"chain.field_of_view.{name}",
            got=f"{np.degrees(limit):.4g} deg to each side: {name}s whose sines differ by"
            f" {found[axis]:.3g} look alike to this array, such as -{within:.3g} and"
            f" {within:.3g} deg",
            need=f"at most {within:.3g} deg, where each {name} looks different",
            fix="Narrow it if targets are nowhere else, or place elements half a wavelength apart.",
        )
    ]


def _likeness(aperture: Aperture, apart: np.ndarray) -> np.ndarray:
    """Correlation of the steering vectors of directions so far apart, (..., 2): (...), 0 to 1."""
    flat = apart.reshape(-1, 2)
    out = np.empty(len(flat))
    each = max(1, _MOST_NUMBERS // aperture.n_elements)
    for first in range(0, len(flat), each):
        phase = 2 * np.pi * (flat[first : first + each] @ aperture.positions[:, 1:].T)
        out[first : first + each] = np.abs(np.mean(np.exp(1j * phase), axis=1))
    return out.reshape(apart.shape[:-1])
