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
    """Return the receivers with a signal of their own, (n,): not constant, dead or copied."""
    is_faulty = recorded.stuck_receiver_mask.copy()
    is_faulty[_dead_receivers(recorded)] = True
    is_faulty |= _first_receiver_copied_always(recorded) >= 0
    return np.flatnonzero(~is_faulty)


def faulty_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report receivers without a signal, or with the samples of another."""
    if recorded.silent_frame_mask[recorded.mask_of_frames_with_samples].all():
        return []
    return [
        *_stuck_receiver_findings(recorded),
        *_dead_receiver_findings(recorded),
        *_copied_receiver_findings(recorded),
    ]


def _stuck_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    is_constant = recorded.constant_receiver_mask_by_frame & ~recorded.silent_frame_mask[:, None]
    if not is_constant.any():
        return []
    is_always = recorded.stuck_receiver_mask
    is_sometimes = is_constant.any(axis=0) & ~is_always
    texts = []
    if is_always.any():
        texts.append(f"in {format_number_ranges('receiver', np.flatnonzero(is_always))}")
    if is_sometimes.any():
        frames = recorded.frame_numbers[is_constant[:, is_sometimes].any(axis=1)]
        receivers = format_number_ranges("receiver", np.flatnonzero(is_sometimes))
        texts.append(f"in {receivers} of {format_number_ranges('frame', frames)}")
    return [_faulty_receiver_finding(f"the same number always {text}") for text in texts]


def _dead_receivers(recorded: RecordingMeasures) -> list[int]:
    """Return receivers far weaker than the median of the others."""
    power = recorded.receiver_power_about_mean
    return [
        rx
        for rx in np.flatnonzero(~recorded.stuck_receiver_mask).tolist()
        if power[rx] < _DEAD_POWER_RATIO * _median_power_of_others(recorded, rx)
    ]


def _median_power_of_others(recorded: RecordingMeasures, rx: int) -> float:
    working = np.flatnonzero(~recorded.stuck_receiver_mask)
    others = recorded.receiver_power_about_mean[working[working != rx]]
    return float(np.median(others)) if others.size else 0.0


def _dead_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    findings = []
    for rx in _dead_receivers(recorded):
        others = _median_power_of_others(recorded, rx)
        power = max(float(recorded.receiver_power_about_mean[rx]), 1e-30 * others)
        below_db = float(to_decibels(others / power))
        findings.append(
            _faulty_receiver_finding(
                f"receiver {rx} {below_db:.1f} dB below the median of the others"
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


def _first_receiver_copied_always(recorded: RecordingMeasures) -> np.ndarray:
    """Return the receiver of which each one is a copy in every frame, (rx,); -1 for none."""
    is_usable = recorded.mask_of_frames_with_samples & ~recorded.silent_frame_mask
    copies = recorded.values_of_measure("copy_of")[is_usable]
    if not len(copies):
        return np.full(recorded.values_of_measure("copy_of").shape[1], -1)
    return np.where(np.all(copies == copies[0], axis=0), copies[0], -1)


def _copied_receiver_findings(recorded: RecordingMeasures) -> list[Finding]:
    return [
        Finding(
            level="warning",
            setting="recording.receivers",
            value=f"receiver {rx} bit-identical to receiver {first}",
            expected="different samples, since two receivers have different noise",
            fix="check the number of receivers and the order of samples in the settings",
        )
        for rx, first in enumerate(_first_receiver_copied_always(recorded).tolist())
        if first >= 0
    ]


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
