"""Trihedral corner reflector, used for calibration."""

import math

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.optical_region import OpticalBody

# Its edges as columns, symmetric about the x axis, the first upright apart from that.
_EDGES = np.array(
    [
        [1 / math.sqrt(3)] * 3,
        [0.0, 1 / math.sqrt(2), -1 / math.sqrt(2)],
        [math.sqrt(2 / 3), -1 / math.sqrt(6), -1 / math.sqrt(6)],
    ]
)


@frozen_dataclass
class CornerReflector(OpticalBody):
    r"""Three metal triangles at right angles, as one scatterer at the origin, the apex.

    It opens towards the x axis, the direction of its largest cross section, with one edge upwards:
    set the heading of the target accordingly. With the cosines :math:`u \le v \le w` between the
    direction and its edges of length a, and s their sum, triple reflection yields

    .. math:: \sigma = \frac{4 \pi a^4}{\lambda^2} \begin{cases}
        (4 u v / s)^2 & u + v \le w \\
        (s - 2 / s)^2 & u + v \ge w \end{cases}

    so that at the peak :math:`\sigma = 4 \pi a^4 / 3 \lambda^2`: 14.4 dBsm for 10 cm at 77 GHz, 3
    dB less some 20 deg off. Single and double reflections, near the planes of the triangles or
    their edges, are neglected: 0 from behind any triangle.

    References
    ----------
    S. D. Robertson, Targets for microwave radar navigation, BSTJ 26 (1947) 852.
    A. W. Doerry, B. C. Brock, Radar cross section of triangular trihedral reflector with
    extended bottom plate, SAND2009-2993 (2009).
    """

    edge_m: float
    """Length of the edge between two triangles, not across the opening."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "edge_m", at_most=1e3)

    @property
    def blocking_box_m(self) -> np.ndarray:
        points_m = self.edge_m * np.concatenate([np.zeros((3, 1)), _EDGES], axis=1)
        return np.stack([points_m.min(axis=1), points_m.max(axis=1)])

    def cross_sections_towards_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Return the cross section, (n_positions, 1); raise if not in the optical region."""
        self.check_optical_size("edge_m", wavelength_m, min_wavelengths=4)
        to_radar = radar_m / np.linalg.norm(radar_m, axis=-1, keepdims=True)
        u, v, w = np.maximum(np.sort(to_radar @ _EDGES, axis=-1), 0.0).T
        # If u is 0, the sum may be 0 too, and so is the result.
        s = np.maximum(u + v + w, 1.0)
        opening = np.where(u + v <= w, 4 * u * v / s, s - 2 / s)
        opening = np.where(u > 0, opening, 0.0)
        peak_m2 = 4 * math.pi * self.edge_m**4 / wavelength_m**2
        return np.asarray(peak_m2 * opening**2)[:, None]
