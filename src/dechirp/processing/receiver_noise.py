"""Correlation of the noise between receivers, which thresholds for independent noise ignore.

Thermal noise differs in each receiver. The phase noise of a strong echo, and of another radar, is
the same in all of them. The covariance matrix C of the receivers, of cells of the range-Doppler map
that contain noise alone, gives the number of receivers with independent noise,

    n_eff = (tr C)^2 / tr(C^2),

n for equal independent noise and 1 for common noise. A power that is averaged over n receivers then
exceeds its mean as that of n_eff receivers does: the threshold of a cell-averaging detector with N
training cells is the quantile of the F distribution with 2 n_eff and 2 n_eff N degrees of freedom.
"""

import numpy as np
import scipy

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import format_number

# Recordings without an interferer have 0.89 of their receivers or more.
_MAX_SHARE = 0.6
_MIN_CHIRPS, _MIN_CELLS_PER_RECEIVER = 16, 50
# Cells above four medians of their range contain echoes; of a mean of four receivers 1 in 10^4.
_MAX_NOISE_RATIO = 4.0


def count_independent_receivers(samples: np.ndarray, n_slots: int) -> float:
    """Return the number of receivers with independent noise, by the samples of one frame.

    `samples` (chirp, rx, sample), of `n_slots` slots of transmitters, the first of which is used.
    The number of receivers, if there are too few cells.
    """
    slot = samples[::n_slots]
    n_chirps, n_rx, n_samples = slot.shape
    if n_rx < 2 or n_chirps < _MIN_CHIRPS:
        return float(n_rx)
    moving = slot - slot.mean(axis=0)
    moving = moving - moving.mean(axis=2, keepdims=True)
    window = np.hanning(n_chirps)[:, None, None] * np.hanning(n_samples)
    spectrum = np.fft.fft2(moving * window, axes=(0, 2))
    if not np.iscomplexobj(slot):
        spectrum = spectrum[..., : n_samples // 2]
    power = np.sum(abs(spectrum) ** 2, axis=1)
    median = np.median(power, axis=0)
    is_noise = (power < _MAX_NOISE_RATIO * median) & (median > 0)
    if np.count_nonzero(is_noise) < _MIN_CELLS_PER_RECEIVER * n_rx:
        return float(n_rx)
    level = np.sqrt(np.where(median > 0, median, 1.0))
    cells = (spectrum / level).transpose(1, 0, 2)[:, is_noise]
    covariance = cells @ cells.conj().T
    return float(np.trace(covariance).real ** 2 / np.sum(abs(covariance) ** 2))


def correlated_noise_findings(
    n_independent: float,
    n_receivers: int,
    snr: np.ndarray,
    *,
    n_training: int,
    false_alarm_probability: float,
) -> tuple[Finding, ...]:
    """Return a warning on the detections that correlated noise of receivers makes doubtful.

    `snr` are those of all detections: sums over the receivers, relative to the noise of one.
    """
    if n_independent > _MAX_SHARE * n_receivers:
        return ()
    ratio = scipy.special.fdtri(
        2 * n_independent, 2 * n_independent * n_training, 1 - false_alarm_probability
    )
    least_snr = n_receivers * (ratio - 1)
    n_doubtful = int(np.count_nonzero(snr < least_snr))
    if n_doubtful == 0:
        return ()
    return (
        Finding(
            level="warning",
            setting="chain.cfar",
            value=f"the noise of the receivers is correlated: {format_number(n_independent, 2)} of"
            f" {n_receivers} are independent, as with the phase noise of another radar or of a"
            " strong echo, which all receivers have in common;"
            f" {format_count_with_noun(n_doubtful, 'detection')} of {snr.size} below an SNR of"
            f" {format_number(10 * np.log10(least_snr), 3)} dB may be false alarms",
            expected="independent noise in each receiver, for false alarms as designed",
            fix="discard these detections if no other frame confirms them; remove the interferer,"
            " or lower chain.cfar.false_alarm_probability",
        ),
    )
