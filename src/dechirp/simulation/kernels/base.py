"""Input of the kernels: scatterers during a run of chirps, and their transmission.

One scatterer, transmitter k and receiver l yield, at the time t and on the ramp since t_n,

    a g_k g_l w_mk c_m / (|p - tx_k| |p - rx_l|)  exp 2 pi i (f0 tau + S tau t_n - S tau^2 / 2),
    tau = (|p(t) - tx_k| + |p(t) - rx_l|) / c                                   (Stove 1992),

with p the position at the instant of reception, so the phase includes range migration within the
chirp and over chirps, range-Doppler coupling and the residual video phase. The position at
reception
stands for that at reflection: the delay errs by the relative size v / c, 3e-7 at 100 m/s.
Simultaneous transmitters add up.
"""

from typing import NamedTuple

import numpy as np


class Scatterers(NamedTuple):
    """Point scatterers during a run of chirps, in the coordinates of the radar."""

    path_m: np.ndarray
    """(n_terms, n_scatterers, 3): the position at t is the sum of path_m[k] t^k, with t in s
    from the middle of the run."""
    amplitudes: np.ndarray
    """(n_scatterers,) sqrt(W) m^2: amplitude of the echo times both path lengths, before gains."""
    tx_gains: np.ndarray
    """(n_tx, n_scatterers): gain of each transmitter towards each scatterer, amplitude ratios."""
    rx_gains: np.ndarray
    """(n_rx, n_scatterers)."""
    chirp_factors: np.ndarray | None = None
    """(n_chirps, n_scatterers): amplitude factors of the chirps; none: constant amplitudes."""

    def select(self, selected: np.ndarray | slice) -> "Scatterers":
        """Return some of the scatterers."""
        factors = self.chirp_factors
        return Scatterers(
            self.path_m[:, selected],
            self.amplitudes[selected],
            self.tx_gains[:, selected],
            self.rx_gains[:, selected],
            None if factors is None else factors[:, selected],
        )


class Transmission(NamedTuple):
    """Run of chirps, with the positions of the antennas."""

    starts_s: np.ndarray
    """(n_chirps,): start of each ramp, from the middle of the run."""
    weights: np.ndarray
    """(n_chirps, n_tx) complex: weight of each transmitter in each ramp; 0: silent."""
    tx_m: np.ndarray
    """(n_tx, 3)."""
    rx_m: np.ndarray
    """(n_rx, 3)."""
    start_frequency_hz: float
    slope_hz_per_s: float
    adc_start_s: float
    sample_rate_hz: float
