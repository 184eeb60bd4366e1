"""The beat signal as a plain sum over targets, evaluated at every sample.

An echo with delay tau, dechirped by the ramp that is being sent, has the phase (Stove 1992)

    phase / 2 pi = f0 tau + S tau t - S tau^2 / 2,    tau = (|p - tx| + |p - rx|) / c,

t from the start of the ramp, p where the target is at the instant of reception. So the
range moves within the chirp and from chirp to chirp, and range-Doppler coupling and the
residual video phase are in. The target is taken where it is when its echo arrives, not when
it reflected it: the delay comes out wrong by the relative size v / c, 3e-7 at 100 m/s.
"""

import numba
import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_echoes(
    out: np.ndarray,
    amplitudes: np.ndarray,
    positions_m: np.ndarray,
    velocities_m_per_s: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    repetition_s: float,
    adc_start_s: float,
    sample_rate_hz: float,
) -> None:
    """Sum the echoes of one transmitter into `out`, (chirp, rx, sample), complex.

    `amplitudes` (targets,): of an echo, times the range squared. Positions and velocities
    (targets, 3) at the start of the first of its chirps, which are `repetition_s` apart. Sums
    in double precision; one sine, one cosine and two square roots for each sample and target,
    about 40 ns.
    """
    n_chirps, n_rx, n_samples = out.shape
    for m in range(n_chirps):
        for k in range(n_rx):
            for n in range(n_samples):
                on_ramp_s = adc_start_s + n / sample_rate_hz
                time_s = m * repetition_s + on_ramp_s
                total = 0j
                for i in range(len(amplitudes)):
                    there, back = 0.0, 0.0
                    for axis in range(3):
                        at_m = positions_m[i, axis] + velocities_m_per_s[i, axis] * time_s
                        there += (at_m - tx_m[axis]) ** 2
                        back += (at_m - rx_m[k, axis]) ** 2
                    there, back = np.sqrt(there), np.sqrt(back)
                    delay_s = (there + back) / SPEED_OF_LIGHT
                    cycles = start_frequency_hz * delay_s + slope_hz_per_s * delay_s * (
                        on_ramp_s - delay_s / 2
                    )
                    # Whole cycles off before the sine: 26,000 of them at 50 m.
                    phase = 2 * np.pi * (cycles - np.floor(cycles))
                    amplitude = amplitudes[i] / (there * back)
                    total += amplitude * complex(np.cos(phase), np.sin(phase))
                out[m, k, n] += total
