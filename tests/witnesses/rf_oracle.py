"""A radar whose waves are sampled: ramps as sent, delayed, mixed and low-passed.

Nothing here knows of beats. A real wave of a few GHz is sent ramp by ramp, arrives after the
delay of the law in `dechirp.simulation.kernels.base` (there and back from where the scatterer is
at reception), is multiplied by the ramp that is being sent and by the same a quarter of a cycle
behind, and passes a low-pass far wider than any beat, which leaves out the sum frequency.
"""

from typing import NamedTuple

import numpy as np

LIGHT = 299_792_458.0

# Sums of frequencies reach 4.5 GHz, below half of this.
SAMPLE_RATE_HZ = 10e9
# 512 taps, 51 ns, of a sinc up to 0.9 GHz in a Kaiser window: flat within 1e-7 to 0.5 GHz and
# as far down from 1.3 GHz on.
TAPS = 512
TRANSIENT_S = TAPS / 2 / SAMPLE_RATE_HZ
_OFFSETS = np.arange(TAPS + 1) - TAPS / 2
_RESPONSE = np.sinc(2 * 0.9e9 / SAMPLE_RATE_HZ * _OFFSETS) * np.kaiser(TAPS + 1, 16.0)
_RESPONSE /= _RESPONSE.sum()


class Ramp(NamedTuple):
    """One ramp as it is sent."""

    start_s: float
    duration_s: float
    weights: np.ndarray
    """(n_tx,): of the beat, so that the wave is sent with the conjugate phase."""


def receive(scatterers, sent, ramps, m, k, n_samples):
    """Samples of chirp m on receiver k, while all of `ramps` were sent and no other."""
    n = np.arange(n_samples)
    on_ramp_s = sent.adc_start_s + n / sent.sample_rate_hz
    # Each sample with the taps about it.
    t = on_ramp_s[:, None] + _OFFSETS / SAMPLE_RATE_HZ
    wave = arriving(scatterers, sent, ramps, k, sent.starts_s[m] + t)
    mixer = 2 * np.pi * (sent.start_frequency_hz * t + sent.slope_hz_per_s * t**2 / 2)
    in_phase, quadrature = 2 * wave * np.cos(mixer), 2 * wave * np.sin(mixer)
    return in_phase @ _RESPONSE + 1j * (quadrature @ _RESPONSE)


def arriving(scatterers, sent, ramps, k, at_s):
    """The real wave on one receiver at given times."""
    wave = np.zeros(at_s.shape)
    for i, amplitude in enumerate(scatterers.amplitudes):
        at_m = sum(
            term[i] * at_s[..., None] ** power for power, term in enumerate(scatterers.path_m)
        )
        back_m = np.linalg.norm(at_m - sent.rx_m[k], axis=-1)
        for j, tx_m in enumerate(sent.tx_m):
            there_m = np.linalg.norm(at_m - tx_m, axis=-1)
            size = amplitude * scatterers.tx_gains[j, i] * scatterers.rx_gains[k, i]
            for ramp in ramps:
                sent_s = at_s - (there_m + back_m) / LIGHT - ramp.start_s
                cycles = sent.start_frequency_hz * sent_s + sent.slope_hz_per_s * sent_s**2 / 2
                phase = 2 * np.pi * cycles - np.angle(ramp.weights[j])
                on = (sent_s >= 0) & (sent_s < ramp.duration_s)
                wave += on * abs(ramp.weights[j]) * size / (there_m * back_m) * np.cos(phase)
    return wave
