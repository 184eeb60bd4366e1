"""Findings on the analogue-to-digital converter: clipping and offset."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.processing.quality.recording_measures import RecordingMeasures

_FULL_SCALE_END = 1 - 2**-15
"""Highest value of a 16-bit converter, of full scale. Those of fewer bits have lower ones, but
readers scale their codes, or they are found by their pile-up."""
_MIN_PILE_RATIO = 8
"""Values at the end over those at the next level: a sine has 2.4, the crest of any smooth echo at
most 5.3 (1 / (2^(1/4) - 1), of the fourth power), a clipped one tens and more."""
_MIN_PILE = 20  # values in a pile-up; extremes of noise are single
# Levels from end to end; with fewer, one level may hold most values without clipping.
_MIN_STEPS = 32
_WARNING_SHARE = 1e-3
"""Share above which clipping is a warning. Noise clipped in 1e-3 of its samples has errors 36 dB
below itself; smaller ones are below the noise."""
_LARGE_OFFSET = 0.5  # of full scale: echoes lose half the range, 6 dB
_OFFSET = 0.1


def clipping_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report values at the ends of the converter's range, counted exactly."""
    counts = _count_clipped_values(recorded)
    n_clipped = int(counts.sum())
    if not n_clipped:
        return []
    n_parts = 2 if recorded.has_complex_samples else 1
    n_values = np.maximum(recorded.values_of_measure("n_numbers") * n_parts, 1)[:, None]
    shares = counts / n_values
    n_total = int(recorded.values_of_measure("n_numbers").sum()) * n_parts * counts.shape[1]
    frame, rx = np.unravel_index(np.argmax(shares), shares.shape)
    noun = "values, I and Q counted separately," if recorded.has_complex_samples else "samples"
    frames = recorded.frame_numbers
    return [
        Finding(
            level="warning" if shares.max() > _WARNING_SHARE else "note",
            setting="recording.clipping",
            value=f"{n_clipped} of {n_total} {noun} at an end of the converter's range, in"
            f" {format_number_ranges('receiver', np.flatnonzero(counts.any(axis=0)))},"
            f" {format_number_ranges('frame', frames[counts.any(axis=1)])}; most in receiver {rx}"
            f" of frame {frames[frame]}: {shares.max():.3%}",
            expected="echoes within the range, since clipping creates false ranges",
            fix="lower the receivers' gain, or keep strong reflectors out of the near field",
        )
    ]


def _count_clipped_values(recorded: RecordingMeasures) -> np.ndarray:
    """Count the values at an end of the range, (frame, rx).

    An end is the highest or lowest value of a receiver, if it is the end of full scale, or if it
    piles up: the counts there and at the next level differ so much that values must be clipped.
    Runs of equal values would be less specific: slow echoes have them at their crests, and fast
    ones have none where they are clipped.
    """
    level, count = (
        recorded.values_of_measure("level").astype(np.float64),
        recorded.values_of_measure("count"),
    )
    is_usable = (
        recorded.mask_of_frames_with_samples[:, None] & ~recorded.constant_receiver_mask_by_frame
    )
    out = np.zeros(is_usable.shape, np.int64)
    for rx in range(is_usable.shape[1]):
        rx_level, rx_count = level[is_usable[:, rx], rx], count[is_usable[:, rx], rx]
        if not len(rx_level):
            continue
        span = rx_level[:, :, 0, 0].max() - rx_level[:, :, 1, 0].min()
        for end, sign in enumerate((1.0, -1.0)):
            numbers, occurrences = sign * rx_level[:, :, end], rx_count[:, :, end]
            extreme = numbers.max()
            n_at_extreme = np.where(numbers == extreme, occurrences, 0).sum(axis=(1, 2))
            # A constant part has no next level: -inf occurs 0 times.
            next_level = np.max(numbers[numbers < extreme], initial=-np.inf)
            n_next = occurrences[numbers == next_level].sum()
            is_pile = (
                n_at_extreme.sum() >= max(_MIN_PILE, _MIN_PILE_RATIO * n_next)
                and span >= _MIN_STEPS * (extreme - next_level)
            )  # fmt: skip
            if is_pile or (recorded.is_normalised_to_full_scale and extreme >= _FULL_SCALE_END):
                out[is_usable[:, rx], rx] += n_at_extreme
    return out


def adc_offset_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report the mean of each receiver, if it is large in itself or relative to the rest."""
    if not recorded.mask_of_frames_with_samples.any():
        return []
    is_usable = ~recorded.stuck_receiver_mask
    mean = recorded.values_of_measure("mean")[recorded.mask_of_frames_with_samples].mean(axis=0)
    rest_rms = np.sqrt(recorded.receiver_power_about_mean)
    size = np.abs(mean).max(axis=1)
    is_large = is_usable & (np.sqrt((mean**2).sum(axis=1)) > rest_rms)
    if recorded.is_normalised_to_full_scale:
        is_large |= is_usable & (size > _OFFSET)
    if not is_large.any():
        return []
    worst = int(np.argmax(np.where(is_large, size, -1.0)))
    part = int(np.argmax(np.abs(mean[worst])))
    part_text = f" {'IQ'[part]} of" if recorded.has_complex_samples else ""
    unit = " sqrt(W)" if recorded.has_absolute_units else ""
    if recorded.is_normalised_to_full_scale:
        unit = " of full scale"
    over_rest = np.abs(mean[worst, part]) / max(rest_rms[worst], 1e-45)  # smallest float32
    is_too_large = recorded.is_normalised_to_full_scale and size[worst] > _LARGE_OFFSET
    return [
        Finding(
            level="warning" if is_too_large else "note",
            setting="recording.offset",
            value=f"a non-zero mean in {format_number_ranges('receiver', np.flatnonzero(is_large))}"
            f", the largest in{part_text} receiver {worst}: {mean[worst, part]:.4g}{unit},"
            f" {over_rest:.3g} times the RMS of the rest",
            expected="samples about zero, since an offset reduces the range of the converter and"
            " appears"
            " as an echo at range 0",
            fix="adjust the receiver's offset, since echoes have at most half the range"
            if is_too_large
            else "no action needed; a window keeps it in the first range bins",
        )
    ]
