r"""Circle fitted to the I/Q values of a moving target, with its offset.

An echo of constant amplitude a beside static echoes moves on an arc of the complex plane,

.. math:: z_n = c + a\, e^{\mathrm{i} \varphi_n} + w_n

with the sum c of the static echoes, leakage and offsets of the receiver. The phase of z - c is that
of the target alone. The centre and the radius minimise the sum of squared distances from the
circle: for white noise the maximum-likelihood estimate to first order. Taubin's algebraic fit
starts the Gauss-Newton iteration.

References
----------
G. Taubin, Estimation of planar curves, surfaces and nonplanar space curves, IEEE Trans. PAMI
13(11), 1991. N. Chernov, Circular and Linear Regression, 2010, chapters 4 and 5.
"""

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass

_MAX_ITERATIONS = 50


@frozen_dataclass
class Arc:
    """Circle through I/Q values, in their unit."""

    centre: complex
    radius: float
    covariance: tuple[tuple[float, float, float], ...]
    """Of the real and imaginary parts of the centre, and of the radius; infinite for a line."""
    noise_std: float
    """Standard deviation of the distances from the circle."""

    @property
    def radius_std(self) -> float:
        """Standard error of the radius."""
        return float(np.sqrt(self.covariance[2][2]))


@check_argument_types
def fit_arc(values: np.ndarray) -> Arc:
    """Fit a circle to complex values, with the covariance of its parameters.

    Parameters
    ----------
    values : array (time,), complex
        Four or more.

    Raises
    ------
    InvalidSetting
        If there are fewer than four values, some are not finite, or all are equal.
    """
    values = np.asarray(values, np.complex128)
    if values.ndim != 1 or values.size < 4 or not np.isfinite(values).all() or not np.ptp(values):
        raise InvalidSetting(
            "values",
            value=f"an array of shape {values.shape}",
            expected="four or more finite complex values in one dimension, not all equal",
            fix="pass the values of one range cell and one channel",
        )
    mean = values.mean()
    scale = np.sqrt(np.mean(abs(values - mean) ** 2))
    points = (values - mean) / scale
    centre, radius = _taubin_circle(points)
    for _ in range(_MAX_ITERATIONS):
        distances, jacobian = _distances_and_jacobian(points, centre, radius)
        step = np.linalg.lstsq(jacobian, -distances, rcond=None)[0]
        centre, radius = centre + complex(step[0], step[1]), radius + step[2]
        if abs(step).max() < 1e-10 * radius:
            break
    distances, jacobian = _distances_and_jacobian(points, centre, radius)
    variance = float(distances @ distances) / (points.size - 3)
    information = jacobian.T @ jacobian
    # Points on a line do not determine a circle: the condition reaches that of rounding.
    if np.linalg.cond(information) > 1e14:
        covariance = np.diag([np.inf] * 3)
    else:
        covariance = variance * np.linalg.inv(information) * scale**2
    return Arc(
        centre=complex(mean + scale * centre),
        radius=float(scale * abs(radius)),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        noise_std=float(scale * np.sqrt(variance)),
    )


def _taubin_circle(points: np.ndarray) -> tuple[complex, float]:
    """Return centre and radius of Taubin's fit to points of mean 0 and variance 1."""
    square = abs(points) ** 2
    mean_square = square.mean()
    design = np.stack(
        [(square - mean_square) / (2 * np.sqrt(mean_square)), points.real, points.imag], axis=1
    )
    weights = np.linalg.svd(design, full_matrices=False)[2][-1]
    curvature = weights[0] / (2 * np.sqrt(mean_square))
    # A line has curvature 0; a circle of 1e6 times the extent does not differ from it.
    curvature = np.copysign(max(abs(curvature), 1e-6), curvature)
    centre = -complex(weights[1], weights[2]) / (2 * curvature)
    return centre, float(np.sqrt(abs(centre) ** 2 + mean_square))


def _distances_and_jacobian(
    points: np.ndarray, centre: complex, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed distances from a circle, and their derivatives by its parameters."""
    from_centre = points - centre
    magnitudes = np.maximum(abs(from_centre), np.finfo(float).tiny)
    unit = from_centre / magnitudes
    return magnitudes - radius, np.stack([-unit.real, -unit.imag, -np.ones(points.size)], axis=1)
