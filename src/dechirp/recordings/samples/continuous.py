"""Continuous recordings: division of consecutive chirps into frames by the radar's settings."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_number, format_si
from dechirp.radar.chirp import Sampling
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.radar.velocity_ambiguity import range_shift_per_ambiguity_m
from dechirp.recordings.settings.radar_example import RadarExample


def check_single_receiver_and_sampling(path: Path, radar: Radar, sampling: Sampling) -> None:
    """Raise `RecordingError` unless the radar has one receiver and this kind of sampling."""
    n_rx, radar_sampling = radar.array.n_rx, radar.frame.chirp.sampling
    if n_rx != 1 or radar_sampling != sampling:
        raise RecordingError(
            path,
            value=f"{radar_sampling} samples of {n_rx} receivers in the settings",
            expected=f"{sampling} samples of one receiver, as in all files of this format",
            fix="correct radar.array.rx or radar.frame.chirp.sampling",
        )


# Duration of joined frames: 0.2 m of a walking person, 5 m of a car.
_JOINED_FRAME_S = 0.3
# The fewest chirps with training cells along velocity, and the most.
_MIN_JOINED_CHIRPS, _MAX_JOINED_CHIRPS = 8, 256


def wav_radar_example(sample_rate_hz: float) -> RadarExample:
    """Return the example of a radar that a sound card samples: 2.4 GHz, ramps of 20 ms."""
    return RadarExample(
        start_frequency="2.4 GHz",
        slope="4.35 GHz/s",
        sample_rate_hz=sample_rate_hz,
        n_samples=round(0.02 * sample_rate_hz),
        sampling="real",
        n_chirps=1,
        known=("sample_rate",),
    )


def join_single_chirps(
    radar: Radar, n_chirps: int, interval_s: float | None = None
) -> tuple[Radar, tuple[Finding, ...]]:
    """Return the radar with frames of several chirps in place of single ones, and a note.

    A single chirp has no velocity, and no mean of which static echoes are subtracted. Joined are
    about 0.3 s of chirps, a power of two from 8 to 256, `interval_s` apart as measured (by the
    settings if None). Radars with more chirps a frame, and recordings of fewer than 8 chirps, stay
    unchanged.
    """
    frame = radar.frame
    if frame.n_chirps_total > 1 or n_chirps < _MIN_JOINED_CHIRPS:
        return radar, ()
    interval_s = interval_s or _mean_frame_duration_s(frame)
    n_wanted = np.clip(_JOINED_FRAME_S / interval_s, _MIN_JOINED_CHIRPS, _MAX_JOINED_CHIRPS)
    n_joined = 2 ** int(np.log2(min(n_wanted, n_chirps)) + 0.01)
    note = Finding(
        level="note",
        setting="radar.frame.n_chirps",
        value=f"chosen --set radar.frame.n_chirps={n_joined} because frames of one chirp have no"
        f" velocity: {n_chirps} chirps, {interval_s * 1e3:.4g} ms apart, joined",
        expected="several chirps in a frame, to measure velocity and to remove static echoes",
        fix="give another number of 2 chirps or more for longer or shorter frames",
    )
    joined = replace(frame, n_chirps=n_joined, period_s=None)
    limit_m_per_s = frame.chirp.wavelength_m / 4 / interval_s
    shift_m = abs(range_shift_per_ambiguity_m(joined))
    aliasing = Finding(
        level="note",
        setting="radar.frame.interval",
        value=f"{interval_s * 1e3:.4g} ms between chirps: velocities beyond"
        f" {format_number(limit_m_per_s, 3)} m/s are aliased, off by multiples of"
        f" {format_number(2 * limit_m_per_s, 3)} m/s, and ranges by {format_number(shift_m, 2)} m",
        expected="detections with an ambiguity_number, which are correct",
        fix="record shorter intervals for faster targets",
    )
    return replace(radar, frame=joined), (note, aliasing)


def divide_chirps_into_frames(
    path: Path, radar: Radar, n_chirps: int
) -> tuple[Radar, int, tuple[Finding, ...]]:
    """Return the radar, the number of complete frames in `n_chirps` chirps, and findings.

    The returned radar has no pause between frames.

    Raises
    ------
    RecordingError
        If there is no complete frame.
    """
    frame = radar.frame
    n_frames, n_left = divmod(n_chirps, frame.n_chirps_total)
    if not n_frames:
        raise RecordingError(
            path,
            value=f"{n_chirps} chirps",
            expected=f"at least {frame.n_chirps_total}, one frame (radar.frame.n_chirps)",
            fix="give a smaller radar.frame.n_chirps, or record for longer",
        )
    findings = []
    if n_left:
        findings.append(chirps_left_out_note(n_frames, frame, n_left))
    period_s = frame.period_s
    if period_s is not None and period_s > 1.01 * _mean_frame_duration_s(frame):
        findings.append(
            Finding(
                level="warning",
                setting="radar.frame.period",
                value=f"{format_si(period_s, 's')}, ignored: the recording has no pauses",
                expected=f"{format_si(_mean_frame_duration_s(frame), 's')}, the chirps of a frame",
                fix="leave out radar.frame.period",
            )
        )
        radar = replace(radar, frame=replace(frame, period_s=None))
    return radar, n_frames, tuple(findings)


def chirps_left_out_note(n_frames: int, frame: Frame, n_left: int) -> Finding:
    """Return the note on chirps after the last complete frame."""
    return Finding(
        level="note",
        setting="recording",
        value=f"{format_count_with_noun(n_frames, 'complete frame')} of {frame.n_chirps_total}"
        f" chirps, and {format_count_with_noun(n_left, 'chirp')}"
        f" that {'is' if n_left == 1 else 'are'} left out",
        expected="complete frames",
        fix="give another radar.frame.n_chirps to read them",
    )


def chirp_interval_findings(
    frame: Frame, measured_interval_s: float, *, source: str
) -> tuple[Finding, ...]:
    """Warn if the measured chirp interval differs from the settings by more than 1 %."""
    expected_s = _mean_frame_duration_s(frame) / frame.n_chirps_total
    ratio = measured_interval_s / expected_s
    if abs(ratio - 1) <= 0.01:
        return ()
    return (
        Finding(
            level="warning",
            setting="radar.frame.interval",
            value=f"{format_si(expected_s, 's')}, but {format_si(measured_interval_s, 's')} on"
            f" average by {source}",
            expected="the interval at which the chirps were sent",
            fix=f"give the measured one: true times are {ratio:.4g} of those shown, true velocities"
            f" {1 / ratio:.4g}",
        ),
    )


def _mean_frame_duration_s(frame: Frame) -> float:
    """Return the mean duration of the chirps of a frame, over all intervals."""
    durations_s = [frame.for_frame(index).duration_s for index in range(frame.n_intervals)]
    return sum(durations_s) / len(durations_s)


def chirp_start_samples(frame: Frame, index: int) -> np.ndarray:
    """Return the first sample of each chirp of a frame, (chirp,) int64, pauses included."""
    return np.rint(_chirp_starts(frame, index)).astype(np.int64)


def chirp_start_offsets(frame: Frame, n_frames: int) -> np.ndarray:
    """Return the starts of the chirps after their first samples, (frame, chirp) in intervals."""
    starts = np.array([_chirp_starts(frame, index) for index in range(n_frames)])
    return np.asarray(starts - np.rint(starts))


def _chirp_starts(frame: Frame, index: int) -> np.ndarray:
    """Return the start of each chirp of a frame, (chirp,) in sample intervals."""
    chirp = frame.chirp
    starts_s = frame.frame_start_s(index) + frame.for_frame(index).chirp_starts_s
    return np.asarray((starts_s + chirp.adc_start_s) * chirp.sample_rate_hz)


def count_frames_with_pauses(path: Path, frame: Frame, n_samples: int) -> int:
    """Return the number of frames whose last chirp is complete, pauses included.

    Raises
    ------
    RecordingError
        If there is none.
    """

    def end_sample(index: int) -> int:
        return int(chirp_start_samples(frame, index)[-1]) + frame.chirp.n_samples

    period_s = frame.frame_start_s(frame.n_intervals) / frame.n_intervals
    n_frames = math.ceil(n_samples / (period_s * frame.chirp.sample_rate_hz)) + 1
    while n_frames and end_sample(n_frames - 1) > n_samples:
        n_frames -= 1
    if n_frames:
        return n_frames
    raise RecordingError(
        path,
        value=f"{n_samples} samples",
        expected=f"at least {end_sample(0)}, one frame of {frame.n_chirps_total} chirps"
        " (radar.frame)",
        fix="give a smaller radar.frame.n_chirps, or record for longer",
    )
