"""What every kernel sums: scatterers during a run of chirps, and what is sent at them.

One scatterer, transmitter k and receiver l give, at the time t and on the ramp since t_n,

    a g_k g_l w_mk c_m / (|p - tx_k| |p - rx_l|)  exp 2 pi i (f0 tau + S tau t_n - S tau^2 / 2),
    tau = (|p(t) - tx_k| + |p(t) - rx_l|) / c                                   (Stove 1992),

p where the scatterer is at the instant of reception, so that the range moves within the
chirp and from chirp to chirp, and range-Doppler coupling and the residual video phase are
in. It is taken where it is when its echo arrives, not when it reflected it: the delay comes
out wrong by the relative size v / c, 3e-7 at 100 m/s. Transmitters that send together add up.
"""

from typing import NamedTuple

import numpy as np


class Scatterers(NamedTuple):
    """Point scatterers during a run of chirps, in the coordinates of the radar."""

    path_m: np.ndarray
    """(n_terms, n_scatterers, 3): at t the position is the sum of path_m[k] t^k, t in s from
    the middle of the run."""
    amplitudes: np.ndarray
    """(n_scatterers,) sqrt(W) m^2: amplitude of the echo times both ways' lengths, before gains."""
    tx_gains: np.ndarray
    """(n_tx, n_scatterers): of each transmitter towards each scatterer, amplitude ratios."""
    rx_gains: np.ndarray
    """(n_rx, n_scatterers)."""
    chirp_factors: np.ndarray | None = None
    """(n_chirps, n_scatterers): by which amplitudes vary from chirp to chirp; none: they do not."""


class Sent(NamedTuple):
    """A run of chirps, and from where they are sent and received."""

    starts_s: np.ndarray
    """(n_chirps,): start of each ramp, from the middle of the run."""
    weights: np.ndarray
    """(n_chirps, n_tx) complex: what each transmitter sends of each ramp; 0: it is silent."""
    tx_m: np.ndarray
    """(n_tx, 3)."""
    rx_m: np.ndarray
    """(n_rx, 3)."""
    start_frequency_hz: float
    slope_hz_per_s: float
    adc_start_s: float
    sample_rate_hz: float
