"""Findings on receivers: silent, stuck, dead, copied or swapped."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.units import to_decibels
from dechirp.processing.quality.receiver_order import (
    find_better_receiver_order,
    find_receiver_order_on_line,
)
from dechirp.processing.quality.recording_measures import RecordingMeasures

_DEAD_POWER_RATIO = 1e-3  # -30 dB, which no antenna pattern reaches in all directions


def silent_frame_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report frames in which all samples are equal."""
    is_silent = recorded.silent_frame_mask
    if not is_silent.any():
        return []
    level = recorded.values_of_measure("level")[is_silent]
    content = "zero" if not np.any(level[..., 0]) else "the same number in each receiver"
    frames = recorded.frame_numbers[is_silent]
    n_arrived = int(recorded.mask_of_frames_with_samples.sum())
    frame_text = (
        "all frames" if is_silent.sum() == n_arrived else format_number_ranges("frame", frames)
    )
    return [
        Finding(
            level="warning",
            setting="recording",
            value=f"silent in {frame_text}: every sample is {content}",
            expected="at least receiver noise",
            fix="check that the radar was transmitting, and the offset of the samples in the"
            " settings",
        )
    ]


def working_receivers(recorded: RecordingMeasures) -> np.ndarray:
    """Return the receivers with a signal of their own in each frame, (n,).

    A receiver that is constant, dead or copied in some frames corrupts the directions of those.
    """
    is_faulty = (_constant_receiver_mask(recorded) | _dead_receiver_mask(recorded)) | (
        _first_receivers_copied(recorded) >= 0
    )
    return np.flatnonzero(~is_faulty.any(axis=0) & ~recorded.stuck_receiver_mask)


def faulty_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report receivers without a signal, or with the samples of another."""
    if recorded.silent_frame_mask[recorded.mask_of_frames_with_samples].all():
        return []
    return [
        *_stuck_receiver_findings(recorded),
        *_dead_receiver_findings(recorded),
        *_copied_receiver_findings(recorded),
    ]


def _constant_receiver_mask(recorded: RecordingMeasures) -> np.ndarray:
    """Return the mask (frame, rx) of constant samples in frames with a signal."""
    return recorded.constant_receiver_mask_by_frame & ~recorded.silent_frame_mask[:, None]


def _stuck_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    return [
        _faulty_receiver_finding(f"the same number always in {receivers}")
        for receivers in _format_receivers_and_frames(_constant_receiver_mask(recorded), recorded)
    ]


def _format_receivers_and_frames(is_faulty: np.ndarray, recorded: RecordingMeasures) -> list[str]:
    """Return texts on the receivers of a mask (frame, rx): of all frames, and of some."""
    usable = recorded.mask_of_frames_with_samples & ~recorded.silent_frame_mask
    is_always = is_faulty[usable].all(axis=0) & usable.any()
    is_sometimes = is_faulty.any(axis=0) & ~is_always
    texts = []
    if is_always.any():
        texts.append(format_number_ranges("receiver", np.flatnonzero(is_always)))
    if is_sometimes.any():
        frames = recorded.frame_numbers[is_faulty[:, is_sometimes].any(axis=1)]
        receivers = format_number_ranges("receiver", np.flatnonzero(is_sometimes))
        texts.append(f"{receivers} of {format_number_ranges('frame', frames)}")
    return texts


def _power_relative_to_others(recorded: RecordingMeasures) -> np.ndarray:
    """Return the power of each receiver over the median of the others, (frame, rx).

    Constant receivers count for none; NaN where there are no others.
    """
    power = recorded.values_of_measure("power").sum(axis=2)
    is_usable = recorded.mask_of_frames_with_samples[:, None]
    power = np.where(is_usable & ~recorded.constant_receiver_mask_by_frame, power, np.nan)
    ratio = np.full(power.shape, np.nan)
    for rx in range(power.shape[1]):
        others = np.delete(power, rx, axis=1)
        is_known = np.isfinite(others).any(axis=1)
        medians = np.nanmedian(others[is_known], axis=1)
        with np.errstate(over="ignore"):  # infinite over receivers without power
            ratio[is_known, rx] = power[is_known, rx] / np.maximum(medians, 1e-300)
    return ratio


def _dead_receiver_mask(recorded: RecordingMeasures) -> np.ndarray:
    """Return the mask (frame, rx) of receivers far weaker than the median of the others."""
    return np.asarray(_power_relative_to_others(recorded) < _DEAD_POWER_RATIO)


def _dead_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    findings = []
    is_dead, ratio = _dead_receiver_mask(recorded), _power_relative_to_others(recorded)
    for rx in np.flatnonzero(is_dead.any(axis=0)):
        mean_ratio = max(float(ratio[is_dead[:, rx], rx].mean()), 1e-30)
        (receiver,) = _format_receivers_and_frames(
            is_dead & (np.arange(is_dead.shape[1]) == rx), recorded
        )
        findings.append(
            _faulty_receiver_finding(
                f"{receiver} {-to_decibels(mean_ratio):.1f} dB below the median of the others"
            )
        )
    return findings


def _faulty_receiver_finding(observed: str) -> Finding:
    return Finding(
        level="warning",
        setting="recording.receivers",
        value=observed,
        expected="receivers of about equal power; a dead one corrupts angles",
        fix="check that it was enabled (receiver mask) and connected, or remove it",
    )


def _first_receivers_copied(recorded: RecordingMeasures) -> np.ndarray:
    """Return the receiver of which each one is a copy, (frame, rx); -1 for none."""
    is_usable = recorded.mask_of_frames_with_samples & ~recorded.silent_frame_mask
    copies = recorded.values_of_measure("copy_of")
    return np.where(is_usable[:, None], copies, -1).astype(int)


def _copied_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    copies = _first_receivers_copied(recorded)
    findings = []
    for rx in np.flatnonzero((copies >= 0).any(axis=0)):
        for first in np.unique(copies[copies[:, rx] >= 0, rx]).tolist():
            is_copy = (copies == first) & (np.arange(copies.shape[1]) == rx)
            (receiver,) = _format_receivers_and_frames(is_copy, recorded)
            findings.append(
                Finding(
                    level="warning",
                    setting="recording.receivers",
                    value=f"{receiver} bit-identical to receiver {first}",
                    expected="different samples, since two receivers have different noise",
                    fix="check the number of receivers and the order of samples in the settings",
                )
            )
    return findings


def receiver_order_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report receivers on a line whose order differs from the settings."""
    line_order = find_receiver_order_on_line(recorded.radar.array)
    cells = recorded.values_of_measure("seen")
    if line_order is None or cells.shape[2] != line_order.size:
        return []
    better = find_better_receiver_order(
        cells.reshape(-1, line_order.size),
        recorded.values_of_measure("seen_snr").reshape(-1),
        line_order,
    )
    if better is None:
        return []
    names = " ".join(map(str, better.order))
    given_names = " ".join(str(int(rx)) for rx in line_order)
    return [
        Finding(
            level="warning",
            setting="recording.receiver_order",
            value=f"{given_names} along the line, in which beams have a gain of"
            f" {better.given_gain:.2f}"
            f" on the mean of {better.n_cells} echoes; {names} has {better.gain:.2f}",
            expected="the physical order of the receivers, in which echoes have a gain near 1",
            fix="correct radar.array.rx; the reversed order, which mirrors angles, fits equally"
            " well",
        )
    ]
