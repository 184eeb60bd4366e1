"""Stereo WAV radars ("coffee can"): the beat signal, and the sync of the ramps.

Channel 1 is the beat signal, channel 2 a square wave that is high during each up-ramp; or the
reverse, since the two levels of a square wave identify it. Sound cards invert both, which is undone
(`encoding` inverted, the default); `upright` takes them unchanged. A chirp begins at a rising edge
of the sync.

The sync of a triangular radar is high for half of the time, so the opposite polarity selects the
down-ramps. Their beat frequencies are as good, but the range-Doppler coupling and the velocities
of moving targets have the opposite sign. The file does not state the polarity; a run reads the
other ramps if the ranges of moving targets show the opposite sign, see
`processing.velocity_ambiguity.sign_by_range_rate`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.samples.continuous import (
    check_single_receiver_and_sampling,
    chirp_interval_findings,
    divide_chirps_into_frames,
    join_single_chirps,
    wav_radar_example,
)
from dechirp.recordings.samples.stationary_tones import StationaryTones
from dechirp.recordings.settings.radar_example import RadarExample
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.riff import Wav, is_wav_header, parse_wav_header

_BLOCK = 2**18
_MAX_LEVEL_SAMPLES = 2**20
_N_LEVEL_BLOCKS, _LEVEL_BLOCK = 64, 2**12
_MAX_SQUARE_WAVE_MIDDLE = 0.2
_N_SMOOTHED = 8  # ramps on each side; in captures with RC generators, lines of 33 are too long
_MAX_ROUNDING = 0.6  # intervals: rounding up, and the error of a line
_BEAT, _SYNC = 0, 1


@frozen_dataclass
class SyncWav(Format):
    """Stereo WAV radars: beat signal, and sync of the ramps.

    One file; chirps follow one another, and the radar's settings divide them into frames. Single
    chirps are joined, see `join_single_chirps`. Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding",)
    encodings: ClassVar[tuple[str, ...]] = ("inverted", "upright")

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            if not is_wav_header(file.read(12)):
                return MatchQuality.NO
        try:
            n_channels = parse_wav_header(path).n_channels
        except RecordingError:  # `read` reports the damage
            n_channels = 2
        # One channel is a beat signal without a sync, see `ContinuousWav`.
        return MatchQuality.POSSIBLE if n_channels == 1 else MatchQuality.CONTAINER

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        sign = 1 if hints.encoding == "upright" else -1
        recording = parse_wav_header(path)
        # The search for the sync takes as long for the example as for the chirps.
        example = None if hints.settings else _radar_example(recording, sign)
        settings = find_recording_settings(path, hints, example)
        if recording.n_channels == 2 and settings.radar.frame.chirp.sampling == "complex":
            raise RecordingError(
                path,
                value="2 channels, and complex samples in the settings",
                expected="real samples and their sync; or I and Q, without a sync",
                fix="set radar.frame.chirp.sampling: real, or give --format continuous-wav for I"
                " and Q",
            )
        check_single_receiver_and_sampling(path, settings.radar, "real")
        chirp = settings.radar.frame.chirp
        rate_hz = recording.sample_rate_hz
        if recording.n_channels != 2 or abs(chirp.sample_rate_hz / rate_hz - 1) > 1e-6:
            raise RecordingError(
                path,
                value=f"{recording.n_channels} channels, sampled at {format_si(rate_hz, 'hz')}",
                expected="2 channels, the beat signal and its sync, sampled at"
                f" {format_si(chirp.sample_rate_hz, 'hz')}, the radar.frame.chirp.sample_rate",
                fix="correct the settings, or record both channels",
            )
        recording = _put_sync_last(recording)
        delay = round(chirp.adc_start_s * rate_hz)
        ramps = _find_ramps_by_sync(recording, sign, delay + chirp.n_samples)
        joined_radar, joined_findings = join_single_chirps(
            settings.radar, len(ramps.starts), ramps.interval_s
        )
        radar, n_frames, frame_findings = divide_chirps_into_frames(
            path, joined_radar, len(ramps.starts)
        )
        n_chirps = radar.frame.n_chirps_total
        chirp_starts, start_offsets = (
            values[: n_frames * n_chirps].reshape(n_frames, n_chirps)
            for values in (ramps.starts, ramps.start_offsets)
        )
        findings = (
            settings.findings
            + recording.findings
            + joined_findings
            + frame_findings
            + ramps.findings
        )
        if hints.encoding is None:
            findings += (_assumed_sync_polarity_note(),)
        if ramps.interval_s is not None:
            findings += chirp_interval_findings(radar.frame, ramps.interval_s, source="the sync")

        def decode(index: int, out: np.ndarray) -> None:
            (present,) = np.nonzero(chirp_starts[index] >= 0)
            out[chirp_starts[index] < 0] = 0
            if not present.size:
                return
            # All chirps at once: opening the file for each of them takes as long as all the rest.
            starts = chirp_starts[index, present] + delay
            first = int(starts[0])
            n_samples = int(starts[-1]) - first + chirp.n_samples
            beat = recording.read_samples(first, n_samples)[:, _BEAT]
            samples = sliding_window_view(beat, chirp.n_samples)[starts - first]
            is_finite = np.isfinite(samples).all(axis=1)
            if not is_finite.all():
                raise RecordingError(
                    path,
                    value=f"non-finite samples in chirp {present[~is_finite][0]} of frame {index}",
                    expected="finite numbers (no NaN, no infinity)",
                    fix="record it again",
                )
            out[present, 0] = samples * np.float32(sign)

        missing = chirp_starts < 0
        tones = None
        if ramps.interval_s is not None:
            tones = StationaryTones(
                lambda first, n: sign * recording.read_samples(first, n)[:, _BEAT],
                n_samples=recording.n_samples,
                sample_rate_hz=rate_hz,
                ramp_interval_s=ramps.interval_s,
                chirp_starts=np.where(missing, -1, chirp_starts + delay),
                n_chirp_samples=chirp.n_samples,
            )
        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            gaps=missing if missing.any() else None,
            start_offsets=start_offsets,
            tones=tones,
            findings=findings,
            other_ramps_encoding=None if hints.encoding else "upright",
        )


@frozen_dataclass
class _Ramps:
    """Start of each ramp of a recording."""

    starts: np.ndarray
    """(chirp,) int64: first sample of each ramp, -1 where its sync is missing."""
    start_offsets: np.ndarray
    """(chirp,): start of each ramp after its first sample, see `_smooth_start_offsets`."""
    interval_s: float | None
    """Mean interval between ramps; None for a single ramp."""
    findings: tuple[Finding, ...] = ()


def _find_ramps_by_sync(recording: Wav, polarity_sign: int, min_samples: int) -> _Ramps:
    """Find the ramps by their sync, and number them so that missing ramps keep their place.

    Raises
    ------
    RecordingError
        If there is no sync, or most of its pulses are shorter than `min_samples` samples.
    """
    low, high = _estimate_sync_levels(recording, polarity_sign)
    middle, half = (low + high) / 2, (high - low) / 4
    if not half > 0:
        raise _no_ramps_error(recording, min_samples, f"a sync that stays at {low:.3g}")
    long_starts, n_short, n_high_samples = [], 0, 0
    for starts, lengths in _iter_sync_high_intervals(
        recording, polarity_sign, middle - half, middle + half, min_samples
    ):
        long = lengths >= min_samples
        long_starts.append(starts[long])
        n_short += int(np.count_nonzero(~long))
        n_high_samples += int(lengths.sum())
    starts = np.concatenate(long_starts)
    if len(starts) <= n_short:
        n_pulses = len(starts) + n_short
        raise _no_ramps_error(
            recording,
            min_samples,
            f"a sync that is high {n_pulses} times, for"
            f" {n_high_samples / max(n_pulses, 1):.6g} samples on average",
        )
    return _assign_ramp_numbers_by_spacing(starts, n_short, recording.sample_rate_hz)


def _radar_example(recording: Wav, polarity_sign: int) -> RadarExample:
    """Return the example of a radar with the times of the sync, if there is one.

    The sweep of amateur radars covers the band at 2.4 GHz, 87 MHz in 20 ms.
    """
    example = wav_radar_example(recording.sample_rate_hz)
    if recording.n_channels != 2:
        return example
    recording = _put_sync_last(recording)
    low, high = _estimate_sync_levels(recording, polarity_sign)
    middle, half = (low + high) / 2, (high - low) / 4
    if not half > 0:
        return example
    starts, lengths = (
        np.concatenate(parts)
        for parts in zip(
            *_iter_sync_high_intervals(recording, polarity_sign, middle - half, middle + half, 1),
            strict=True,
        )
    )
    if len(starts) < 2:
        return example
    rate_hz = recording.sample_rate_hz
    return replace(
        example,
        # Ramps differ by a few samples.
        n_samples=max(int(np.quantile(lengths, 0.1)) - 1, 1),
        interval_s=float(np.median(np.diff(starts))) / rate_hz,
        known=("sample_rate", "n_samples", "interval"),
    )


def _put_sync_last(recording: Wav) -> Wav:
    """Return the recording with its sync in the second channel, and a note if it was the first.

    Of a square wave, edges and noise alone lie between a quarter and three quarters of its span;
    of a sine a third does, of noise nearly all. With neither, the second channel is taken.
    """
    starts = np.linspace(0, recording.n_samples, _N_LEVEL_BLOCKS, endpoint=False).astype(int)
    n_samples = min(_LEVEL_BLOCK, recording.n_samples // _N_LEVEL_BLOCKS + 1)
    blocks = [
        recording.read_samples(start, min(n_samples, recording.n_samples - start))
        for start in starts.tolist()
    ]
    with np.errstate(invalid="ignore"):  # signalling NaN
        levels = np.nan_to_num(np.concatenate(blocks).astype(float), posinf=0.0, neginf=0.0)
    low, high = np.quantile(levels, [0.001, 0.999], axis=0)
    from_middle = abs(levels - (low + high) / 2)
    first, second = np.where(
        high > low, np.mean(from_middle < (high - low) / 4, axis=0), 1.0
    ).tolist()
    if not first < min(_MAX_SQUARE_WAVE_MIDDLE, second / 2):
        return recording
    note = Finding(
        level="note",
        setting="recording",
        value=f"the sync is in channel 1, a square wave: {first:.1%} of its samples lie between its"
        f" levels, of channel 2 {second:.1%}",
        expected="a beat signal in channel 1 and its sync in channel 2, or the reverse",
        fix="no action needed",
    )
    return replace(recording, has_reversed_channels=True, findings=(*recording.findings, note))


def _estimate_sync_levels(recording: Wav, polarity_sign: int) -> tuple[float, float]:
    """Estimate the low and high level of the sync; 0.1 % of the samples may lie beyond each."""
    rng = np.random.default_rng(1)  # regular sampling could be synchronous with the sync
    share = min(1.0, _MAX_LEVEL_SAMPLES / recording.n_samples)
    sampled_blocks = [
        rng.choice(block, math.ceil(share * block.size), replace=False) if share < 1 else block
        for _, block in _iter_sync_blocks(recording, polarity_sign)
    ]
    low, high = np.quantile(np.concatenate(sampled_blocks).astype(float), [0.001, 0.999])
    return float(low), float(high)


def _iter_sync_blocks(recording: Wav, polarity_sign: int) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the sync channel block by block, with the index of the first sample."""
    for first in range(0, recording.n_samples, _BLOCK):
        block = recording.read_samples(first, min(_BLOCK, recording.n_samples - first))[:, _SYNC]
        yield first, np.where(np.isfinite(block), block, np.float32(0)) * np.float32(polarity_sign)


def _iter_sync_high_intervals(
    recording: Wav, polarity_sign: int, lower: float, upper: float, min_samples: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield start and length of the intervals in which the sync is high, block by block.

    The sync is high from where it exceeds `upper` until it falls below `lower`, so noise below half
    of its amplitude makes no edges. A last interval cut by the end of the recording counts if it
    has `min_samples` samples.
    """
    last_edge, state = -1, 0  # index and state of the last edge
    for first, block in _iter_sync_blocks(recording, polarity_sign):
        level = (block > upper).astype(np.int8) - (block < lower)
        crossings = np.flatnonzero(level)
        levels = level[crossings]
        is_edge = levels != np.concatenate([[state], levels])[:-1]
        edges = np.concatenate([[last_edge], first + crossings[is_edge]])
        edge_states = np.concatenate([[state], levels[is_edge]])
        if state == 0 and len(edges) > 1:
            edges[1] = -1  # the start of the recording, not of a ramp
        is_high = (edge_states[:-1] > 0) & (edges[:-1] >= 0)
        yield edges[:-1][is_high], np.diff(edges)[is_high]
        last_edge, state = int(edges[-1]), int(edge_states[-1])
    if state > 0 and 0 <= last_edge <= recording.n_samples - min_samples:
        yield np.array([last_edge]), np.array([recording.n_samples - last_edge])


def _assign_ramp_numbers_by_spacing(
    starts: np.ndarray, n_short_pulses: int, sample_rate_hz: float
) -> _Ramps:
    """Number the ramps by their spacing, with -1 for those that are missing."""
    if len(starts) == 1:
        return _Ramps(starts=starts, start_offsets=np.zeros(1), interval_s=None)
    steps = np.diff(starts)
    median_step = float(np.median(steps))
    periods = np.maximum(np.rint(steps / median_step).astype(np.int64), 1)
    ramp_numbers = np.concatenate([[0], np.cumsum(periods)])
    numbered_starts = np.full(int(ramp_numbers[-1]) + 1, -1, np.int64)
    numbered_starts[ramp_numbers] = starts
    # Intervals of a fractional number of samples vary by one sample.
    is_uneven = abs(steps - periods * median_step) > max(0.01 * median_step, 2)
    findings = []
    if (periods > 1).any() or is_uneven.any() or n_short_pulses:
        longest = int(np.argmax(steps))
        findings.append(
            Finding(
                level="warning",
                setting="recording",
                value=f"an irregular sync: {int((periods - 1).sum())} ramps missing,"
                f" {int(is_uneven.sum())} intervals off by more than 1 %, pulses too short"
                f" {n_short_pulses} times; the longest interval,"
                f" {format_si(steps[longest] / sample_rate_hz, 's', 4)}, begins"
                f" {format_si(starts[longest] / sample_rate_hz, 's', 4)} after the start",
                expected=f"a ramp every {format_si(median_step / sample_rate_hz, 's')}",
                fix="leave out those frames; samples of missing ramps are zero and marked as gaps",
            )
        )
    even_steps = steps[(periods == 1) & ~is_uneven]
    return _Ramps(
        starts=numbered_starts,
        start_offsets=_smooth_start_offsets(numbered_starts),
        interval_s=float(np.mean(even_steps) if even_steps.size else median_step) / sample_rate_hz,
        findings=tuple(findings),
    )


def _smooth_start_offsets(starts: np.ndarray) -> np.ndarray:
    """Return the starts of ramps after their first samples, (ramp,) in sample intervals.

    A ramp begins up to one interval before its first sample, by a generator whose period changes
    slowly: a line through the starts of 17 ramps is accurate to 0.07 intervals. The line is as long
    as all starts are within the rounding of it. The offset is 0 where a start is missing, or more
    than one interval from the line.
    """
    present = starts >= 0
    numbers = np.arange(starts.size)
    trend = np.polynomial.Polynomial.fit(numbers[present], starts[present], 1)
    excess = np.where(present, starts - trend(numbers), 0.0)
    half_length = _N_SMOOTHED
    offsets = _local_lines(excess, present, half_length) - excess
    while half_length < starts.size:
        half_length *= 2
        longer = _local_lines(excess, present, half_length) - excess
        if abs(longer[present]).max() > _MAX_ROUNDING:
            break
        offsets = longer
    return np.where(present & (abs(offsets) <= 1), offsets, 0.0)


def _local_lines(values: np.ndarray, present: np.ndarray, half_length: int) -> np.ndarray:
    """Return the value of the line through the present values about each index, (n,)."""
    distance = np.arange(-half_length, half_length + 1, dtype=float)

    def sum_near(terms: np.ndarray, power: int) -> np.ndarray:
        # The import of scipy.signal would take 0.7 s of CPU time. A circular convolution wraps
        # round into the first sums only, which the padding adds.
        padded = np.pad(terms, half_length)
        kernel = np.fft.rfft((-distance) ** power, padded.size)
        return np.fft.irfft(np.fft.rfft(padded) * kernel, padded.size)[2 * half_length :]

    weights = present.astype(float)
    n, first, second = (sum_near(weights, power) for power in range(3))
    determinant = n * second - first**2
    line = second * sum_near(values * weights, 0) - first * sum_near(values * weights, 1)
    return np.divide(line, determinant, out=values.copy(), where=determinant > 0.5)


def _no_ramps_error(recording: Wav, min_samples: int, value: str) -> RecordingError:
    """Return the error of a recording without usable ramps."""
    return RecordingError(
        recording.path,
        value=value,
        expected=f"a sync that is high for at least {min_samples} samples in most ramps"
        " (radar.frame.chirp.n_samples and adc_start)",
        fix="give fewer samples or the other encoding (inverted or upright), or record the sync"
        " of the ramps in one channel; without a sync, give --format continuous-wav",
    )


def _assumed_sync_polarity_note() -> Finding:
    """Return the note that the polarity of the sync was assumed."""
    return Finding(
        level="note",
        setting="encoding",
        value="missing, assumed to be inverted, as by sound cards",
        expected="the polarity of the sync, which distinguishes up-ramps from down-ramps",
        fix="give --encoding upright if the signals were not inverted, or to read the down-ramps;"
        " a run reads the other ramps if ranges of moving targets show that their velocities have"
        " the wrong sign",
    )
