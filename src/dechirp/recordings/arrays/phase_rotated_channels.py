"""Real samples whose channels were multiplied by constant phase factors, stored as complex numbers.

Files of calibrated arrays hold them: one mixer measured real samples r_k[n], and calibration made
x_k[n] = r_k[n] exp(i phi_k). The factor belongs to the element k, not to the beat signal, so the
samples are read as r_k and the factors go into the calibration of the radar.
"""

from dataclasses import replace

import numpy as np

from dechirp.core.findings import Finding
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.recordings.arrays.encodings import scale_to_full_scale
from dechirp.recordings.arrays.named_array import NamedArray

# Share of the power in quadrature to the fitted phase, at most: 50 dB down, as rounding to 16 bits
# leaves of a signal at -50 dB of full scale. White noise in both parts has half of its power there.
_MAX_QUADRATURE_SHARE = 1e-5


def find_channel_phase_factors(cube: NamedArray, encoding: str, n_slots: int) -> np.ndarray | None:
    """Return the phase factors of real channels in the first frame, (n_slots, n_rx) complex.

    None if the samples are real numbers, or not real up to a factor in each channel. With
    q = sum x^2, p = sum |x|^2 over the samples of a channel, the phase is arg(q) / 2 and the share
    of the power in quadrature to it (1 - |q| / p) / 2. The sign of a factor is arbitrary.
    """
    if not cube.is_complex:
        return None
    squares, power = np.zeros((2, 1, 1), np.complex128)
    for first, numbers in cube.iter_chirp_blocks(0):
        try:
            x = scale_to_full_scale(numbers, encoding).astype(float).view(complex)[..., 0]
        except ValueError:  # numbers outside of the encoding: decoding reports them
            return None
        slots = (first + np.arange(len(x))) % n_slots
        shape = (n_slots, x.shape[1])
        squares = np.broadcast_to(squares, shape).copy()
        power = np.broadcast_to(power, shape).copy()
        np.add.at(squares, slots, np.sum(x**2, axis=2))
        np.add.at(power, slots, np.sum(np.abs(x) ** 2, axis=2))
    if (abs(squares) < (1 - 2 * _MAX_QUADRATURE_SHARE) * power.real).any() or not power.any():
        return None
    factors = np.exp(0.5j * np.angle(squares))
    return None if np.allclose(factors.imag, 0, atol=1e-6) else factors


def add_phase_factors_to_calibration(
    radar: Radar, factors: np.ndarray
) -> tuple[Radar, tuple[Finding, ...]]:
    """Return the radar whose calibration contains the factors, (n_slots, n_rx), and a note."""
    frame, n_rx = radar.frame, radar.array.n_rx
    transmitters = frame.tdm_order or (0,)
    gain = radar.element_corrections.reshape(-1, n_rx).astype(np.complex128)
    for slot, tx in enumerate(transmitters):
        gain[tx] *= factors[slot]
    elements = tuple((tx, rx) for tx in range(len(gain)) for rx in range(n_rx))
    parts = tuple((float(value.real), float(value.imag)) for value in gain.ravel())
    old = radar.calibration or Calibration(elements=elements, gain=parts)
    errors_m = old.position_error_m and tuple(map(tuple, old.element_position_errors_m().tolist()))
    calibration = replace(old, elements=elements, gain=parts, position_error_m=errors_m)
    note = Finding(
        level="note",
        setting="radar.calibration",
        value="complex samples of a radar with real sampling: real but for one phase in each"
        " channel, which was moved into the calibration",
        expected="real samples, or the calibration as radar.calibration",
        fix="nothing is to be done",
    )
    return replace(radar, calibration=calibration), (note,)


def rotate_to_real_samples(
    numbers: np.ndarray, factors: np.ndarray, first_chirp: int
) -> np.ndarray:
    """Return the real samples of chirps (chirp, rx, sample) that were multiplied by the factors.

    `numbers` has I and Q of the products as last axis.

    Raises
    ------
    ValueError
        If a part of the samples is in quadrature to the factors.
    """
    real, imaginary = numbers[..., 0], numbers[..., 1]
    slots = (first_chirp + np.arange(len(numbers))) % len(factors)
    cosine, sine = (part[slots, :, None] for part in (factors.real, factors.imag))
    in_phase, quadrature = real * cosine + imaginary * sine, imaginary * cosine - real * sine
    if np.sum(quadrature**2) > 4 * _MAX_QUADRATURE_SHARE * np.sum(in_phase**2):
        raise ValueError("samples in quadrature to the phase of their channel")
    return np.asarray(in_phase)
