"""A trihedral corner reflector, with which radars are calibrated."""

import math

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.scene.bodies.optical import OpticalBody

# Its edges as columns, alike about the x axis, the first straight up but for that.
_EDGES = np.array(
    [
        [1 / math.sqrt(3)] * 3,
        [0.0, 1 / math.sqrt(2), -1 / math.sqrt(2)],
        [math.sqrt(2 / 3), -1 / math.sqrt(6), -1 / math.sqrt(6)],
    ]
)


@value
class CornerReflector(OpticalBody):
    r"""Three triangles of metal at right angles: one scatterer at the origin, where all meet.

    It opens to the x axis, along which it reflects most, with one of the edges up: give its
    target the heading in which it looks. With the cosines :math:`u \le v \le w` between the
    direction and its edges of length a, and s their sum, three reflections give

    .. math:: \sigma = \frac{4 \pi a^4}{\lambda^2} \begin{cases}
        (4 u v / s)^2 & u + v \le w \\
        (s - 2 / s)^2 & u + v \ge w \end{cases}

    so that at the peak :math:`\sigma = 4 \pi a^4 / 3 \lambda^2`: 14.4 dBsm for 10 cm at 77
    GHz, 3 dB less some 20 deg beside it. What one or two of the triangles reflect by
    themselves, nearly along them or their edges, is left out: 0 from behind any of them.

    References
    ----------
    S. D. Robertson, Targets for microwave radar navigation, BSTJ 26 (1947) 852.
    A. W. Doerry, B. C. Brock, Radar cross section of triangular trihedral reflector with
    extended bottom plate, SAND2009-2993 (2009).
    """

    edge_m: float
    """From the corner along which two triangles meet, not across the opening."""

    def __post_init__(self) -> None:
        positive(self, "edge_m", at_most=1e3)

    def seen_from_m2(self, radar_m: np.ndarray, wavelength_m: float) -> np.ndarray:
        """Cross section, (n_places, 1); refuses with `InvalidSetting` what is not optical."""
        self.must_be_large("edge_m", wavelength_m, wavelengths=4)
        to_radar = radar_m / np.linalg.norm(radar_m, axis=-1, keepdims=True)
        u, v, w = np.maximum(np.sort(to_radar @ _EDGES, axis=-1), 0.0).T
        # Where u is 0 the sum may be as well, and so is what they make of it.
        s = np.maximum(u + v + w, 1.0)
        opening = np.where(u + v <= w, 4 * u * v / s, s - 2 / s)
        opening = np.where(u > 0, opening, 0.0)
        peak_m2 = 4 * math.pi * self.edge_m**4 / wavelength_m**2
        return np.asarray(peak_m2 * opening**2)[:, None]
