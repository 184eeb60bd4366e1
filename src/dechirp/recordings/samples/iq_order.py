"""Order of I and Q in complex samples, inferred from the side of the spectrum with echoes.

An up-chirp has its echoes at positive beat frequencies; samples read with I and Q swapped are
their conjugates times j, with the echoes on the other side.

The strongest static signal is often no echo but the coupling between the antennas, within a few
bins of zero on both sides. The mean over the chirps of a transmitter contains it and is removed,
since moving echoes suffice. Without motion, all echoes count beyond the bins of the coupling.
"""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.settings.base import Iq
from dechirp.theory.windows import window_weights

_NEAR_BINS = 3
"""Bins next to 0 and to half the sample rate that count for no side: a Hann window spreads the
coupling and the converter's offset over them."""
_FALSE_ALARM_PROBABILITY = 1e-6  # of noise, in one spectrum
_CLEAR_SHARE = 0.8  # 6 dB between the sides


@frozen_dataclass
class EchoSides:
    """Energy of echoes over the noise at positive and at negative beat frequencies."""

    positive: float
    negative: float
    echoes: str
    """Echoes that were measured: moving or static ones; empty if none stands out."""

    @property
    def negative_share(self) -> float:
        """Share of the energy at negative beat frequencies; 0.5 without echoes."""
        total = self.positive + self.negative
        return self.negative / total if total > 0 else 0.5


def measure_echo_sides(samples: np.ndarray, *, n_slots: int = 1) -> EchoSides:
    """Measure on which side of the spectrum the echoes in samples (chirp, rx, sample) lie.

    Candidates are the moving echoes beyond the coupling, all echoes beyond it, and both with its
    bins: the first whose sides differ clearly, else the first that stands out. `n_slots` is the
    number of chirps after which a transmitter sends again.
    """
    spectra = [("static", samples)]
    if len(samples) >= 2 * n_slots:
        moving = samples.copy()
        for slot in range(n_slots):
            moving[slot::n_slots] -= samples[slot::n_slots].mean(axis=0)
        # The mean takes the power of one chirp of each transmitter with it: rounding remains.
        if np.vdot(moving, moving).real > 1e-12 * np.vdot(samples, samples).real:
            spectra.insert(0, ("moving", moving))
    candidates = []
    for n_near_bins in (_NEAR_BINS, 1):
        for echoes, echo_samples in spectra:
            positive, negative = _energy_over_noise(echo_samples, n_near_bins)
            sides = EchoSides(positive=positive, negative=negative, echoes=echoes)
            if max(positive, negative) > _CLEAR_SHARE * (positive + negative):
                return sides
            if positive + negative > 0:
                candidates.append(sides)
    return candidates[0] if candidates else EchoSides(positive=0.0, negative=0.0, echoes="")


def _energy_over_noise(samples: np.ndarray, n_near_bins: int) -> tuple[float, float]:
    """Return the energy of the peaks that stand out, at positive and negative frequencies.

    Only peaks count, since the slope of the coupling reaches beyond its bins. The mean of n
    exponential powers exceeds t means with a probability below exp(-n (t - 1 - ln t)) (Chernoff).
    Receivers may share their noise, so that only chirps count.
    """
    n_chirps, n_samples = len(samples), samples.shape[-1]
    weights = window_weights("hann", n_samples).astype(np.float32)
    centred = samples - samples.mean(axis=-1, keepdims=True)
    spectrum = np.fft.fft(centred * weights, axis=-1)
    power = np.mean(spectrum.real**2 + spectrum.imag**2, axis=(0, 1))
    bins = np.arange(n_samples)
    from_zero = np.minimum(bins, n_samples - bins)
    is_counted = (from_zero >= n_near_bins) & (n_samples / 2 - from_zero >= n_near_bins)
    if np.count_nonzero(is_counted) < 4:
        is_counted = (from_zero > 0) & (2 * from_zero < n_samples)
    if not is_counted.any() or not power[is_counted].any():
        return 0.0, 0.0
    exponent = np.log(n_samples / _FALSE_ALARM_PROBABILITY) / n_chirps
    limit = 2.0 + 2.0 * exponent
    for _ in range(30):  # converges from above: the slope is 1 / t
        limit = 1 + exponent + np.log(limit)
    noise = np.median(power[is_counted])
    is_peak = is_counted & (power >= np.roll(power, 1)) & (power >= np.roll(power, -1))
    # A median of few chirps lies below the mean; the ratio of one chirp bounds it.
    energy = np.where(is_peak & (power > limit * noise / np.log(2)), power - noise, 0.0)
    is_positive = bins < n_samples / 2
    return float(energy[is_positive].sum()), float(energy[~is_positive].sum())


def guess_iq_order(samples: np.ndarray, *, n_slots: int = 1) -> tuple[Iq, Finding]:
    """Guess the order of I and Q, from samples (chirp, rx, sample) read with I first.

    Returns
    -------
    iq : {"iq", "qi"}
    finding
        The guess and its evidence: a warning if the sides differ by less than 6 dB.
    """
    sides = measure_echo_sides(samples, n_slots=n_slots)
    iq: Iq = "qi" if sides.negative_share > 0.5 else "iq"
    other = "iq" if iq == "qi" else "qi"
    share = max(sides.negative_share, 1 - sides.negative_share)
    is_clear = share > _CLEAR_SHARE
    evidence = (
        f"with {share:.1%} of the energy of {sides.echoes} echoes at positive beat frequencies"
        if sides.echoes
        else "without any echo that stands out of the noise"
    )
    return iq, Finding(
        level="note" if is_clear else "warning",
        setting="iq",
        value=f"missing, assumed to be {iq}, {evidence}",
        expected="the order in which I and Q of a sample were written",
        fix=f"no action needed if echoes appear at the right ranges; else give --iq {other}"
        if is_clear
        else f"give --iq {other} if ranges are wrong, or --iq {iq} to confirm; with the wrong"
        " order, an echo at range r appears at the largest range minus r",
    )


def negative_beat_frequency_findings(
    samples: np.ndarray, iq: Iq, *, n_slots: int = 1
) -> tuple[Finding, ...]:
    """Warn if echoes lie at negative beat frequencies, where an up-chirp has none."""
    sides = measure_echo_sides(samples, n_slots=n_slots)
    if sides.negative_share <= _CLEAR_SHARE:
        return ()
    return (
        Finding(
            level="warning",
            setting="iq",
            value=f"{iq}, with {sides.negative_share:.1%} of the energy of {sides.echoes} echoes at"
            " negative beat frequencies",
            expected="echoes at positive beat frequencies, as of an up-chirp",
            fix=f"read it with --iq {'qi' if iq == 'iq' else 'iq'}",
        ),
    )
