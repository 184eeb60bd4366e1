"""The Kaiser-Bessel function: how a tone between grid points is spread over its neighbours.

A value at the grid coordinate g goes to the WIDTH nearest points b with the weights

    phi(z) = I0(beta sqrt(1 - z^2)) / I0(beta),   z = 2 (b - g) / WIDTH,

and a transform of the grid sees it as the tone exp(i w g) times the transform of phi,

    phi^(w) = WIDTH sinh(sqrt(beta^2 - (w WIDTH / 2)^2)) / (sqrt(...) I0(beta)),

which is divided out (Jackson et al. 1991; Beatty, Nishimura & Pauly 2005). What is left of
the images was measured over a window filled to its edges: 1.0e-6 root mean square on a grid
1.5 times finer than critical, 6e-8 on one twice as fine.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import i0

from dechirp.echoes.kernels.patches import WIDTH

_DEGREE = 8  # 4e-9 off


class Spreading(NamedTuple):
    """A grid so much finer than critical, and the weights that belong to it."""

    spacing: float
    beta: float
    polynomials: np.ndarray
    """(degree + 1) x WIDTH x 2, flat, float32, highest power first: weight of each point, twice,
    over where the value lies between two, -1 to 1. Signs alternate from point to point."""

    before: np.ndarray
    """Polynomial of degree 10, highest power first, of the square of a frequency over that of
    the edge of the band: by which a tone is multiplied to come out right between the points."""

    def transform(self, angle: np.ndarray) -> np.ndarray:
        """Transform of the weights at some phase steps per grid point, rad; any shape."""
        return _transform(self.beta, angle)


def _transform(beta: float, angle: np.ndarray) -> np.ndarray:
    root = np.sqrt(beta**2 - (np.asarray(angle) * WIDTH / 2) ** 2)
    return np.asarray(WIDTH * np.sinh(root) / (root * i0(beta)))


@cache
def spreading(spacing: float) -> Spreading:
    """Weights for a grid `spacing` times finer than critical, 1.5 or 2."""
    # 2 % under the edge of the images, where the sum of both errors is smallest.
    beta = 0.98 * np.pi * WIDTH * (1 - 0.5 / spacing)
    between = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    z = (between[:, None] / 2 + 0.5 + np.arange(WIDTH)) * 2 / WIDTH - 1
    weights = i0(beta * np.sqrt(np.maximum(1 - z**2, 0))) / i0(beta)
    squares = (1 + between) / 2
    return Spreading(
        spacing,
        beta,
        np.repeat(np.polyfit(between, weights * (-1.0) ** np.arange(WIDTH), _DEGREE), 2).astype(
            np.float32
        ),
        np.polyfit(squares, 1 / _transform(beta, np.pi / spacing * np.sqrt(squares)), 10),
    )
