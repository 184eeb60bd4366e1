"""Chirps that were recorded one after the other, which the radar's settings cut into frames."""

from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.chirp import Sampling
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


def must_be_single(path: Path, radar: Radar, sampling: Sampling) -> None:
    """Raise `RecordingError` unless the radar has one receiver and samples in this way."""
    n_rx, told = radar.array.n_rx, radar.frame.chirp.sampling
    if n_rx != 1 or told != sampling:
        raise RecordingError(
            path,
            got=f"said to hold {told} samples of {n_rx} receivers",
            need=f"{sampling} samples of one receiver: the format holds no others",
            fix="Correct radar.array.rx or radar.frame.chirp.sampling.",
        )


def whole_frames(path: Path, radar: Radar, n_chirps: int) -> tuple[Radar, int, tuple[Finding, ...]]:
    """Number of whole frames in so many chirps, of a radar whose frames leave no gap.

    Raises
    ------
    RecordingError
        If there is not one.
    """
    frame = radar.frame
    n_frames, left = divmod(n_chirps, frame.n_sent)
    if not n_frames:
        raise RecordingError(
            path,
            got=f"a recording of {n_chirps} chirps",
            need=f"of at least {frame.n_sent}, one frame as radar.frame.n_chirps says",
            fix="Give a smaller radar.frame.n_chirps, or record for longer.",
        )
    findings = []
    if left:
        findings.append(
            Finding(
                level="note",
                setting="recording",
                got=f"{n_frames} whole frames of {frame.n_sent} chirps, and {left} chirps that are"
                " left out",
                need="whole frames",
                fix="Give another radar.frame.n_chirps to read them.",
            )
        )
    period_s = frame.period_s
    if period_s is not None and period_s > 1.01 * _mean_duration_s(frame):
        findings.append(
            Finding(
                level="warning",
                setting="radar.frame.period",
                got=f"{period_s:.6g} s, left out: the recording runs on without a gap",
                need=f"{_mean_duration_s(frame):.6g} s, the chirps of a frame",
                fix="Leave out radar.frame.period.",
            )
        )
        radar = replace(radar, frame=replace(frame, period_s=None))
    return radar, n_frames, tuple(findings)


def against_interval(frame: Frame, measured_s: float, *, by: str) -> tuple[Finding, ...]:
    """Warn if chirps came 1 % or more sooner or later than the settings say."""
    told_s = _mean_duration_s(frame) / frame.n_sent
    ratio = measured_s / told_s
    if abs(ratio - 1) <= 0.01:
        return ()
    return (
        Finding(
            level="warning",
            setting="radar.frame.interval",
            got=f"{told_s:.6g} s, but {measured_s:.6g} s on average by {by}",
            need="the interval at which chirps were sent",
            fix=f"Give the measured one: true times are {ratio:.4g} of those shown, true velocities"
            f" {1 / ratio:.4g}.",
        ),
    )


def _mean_duration_s(frame: Frame) -> float:
    """Of the chirps of a frame, over those of all intervals."""
    lasts_s = [frame.at(index).duration_s for index in range(frame.n_intervals)]
    return sum(lasts_s) / len(lasts_s)
