"""WAV recordings without a sync: beat signal alone, or I and Q of a software-defined radio.

I and Q are two files of one channel each, whose names differ in that letter (`walk_I.wav`,
`walk_Q.wav`), or the two channels of one file. The first chirp begins with the file; the others
follow at the times of the radar's settings, pauses between frames included.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.frame import Frame
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.samples.continuous import (
    check_single_receiver_and_sampling,
    chirp_start_offsets,
    chirp_start_samples,
    count_frames_with_pauses,
    divide_chirps_into_frames,
    join_single_chirps,
    wav_radar_example,
)
from dechirp.recordings.samples.iq_files import iq_file_names, leading_iq_file, other_iq_file
from dechirp.recordings.samples.iq_order import negative_beat_frequency_findings
from dechirp.recordings.settings.base import Iq
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.riff import Wav, is_wav_header, parse_wav_header

_MAX_SAMPLED_CHIRPS = 64


@frozen_dataclass
class ContinuousWav(Format):
    """WAV without a sync: the beat signal, or I and Q in two files or two channels.

    Either file of a pair names the recording. Chirps begin with the file, at the times of the
    radar's settings. Single chirps are joined, see `join_single_chirps`. Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            if not is_wav_header(file.read(12)):
                return MatchQuality.NO
        try:
            n_channels = parse_wav_header(path).n_channels
        except RecordingError:  # `SyncWav` reports the damage
            return MatchQuality.POSSIBLE
        # Two channels are mostly a beat signal and its sync.
        return MatchQuality.CONTAINER if n_channels == 1 else MatchQuality.POSSIBLE

    def leading_file(self, path: Path, hints: RecordingHints) -> Path:
        return leading_iq_file(path)

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        example = wav_radar_example(parse_wav_header(path).sample_rate_hz)
        if other_iq_file(path) is not None:
            example = replace(example, sampling="complex", known=(*example.known, "sampling"))
        settings = find_recording_settings(path, hints, example)
        frame = settings.radar.frame
        sampling = frame.chirp.sampling
        check_single_receiver_and_sampling(path, settings.radar, sampling)
        files = _open_files_of_recording(path, is_complex=sampling == "complex")
        rate_hz = files[0].sample_rate_hz
        if abs(frame.chirp.sample_rate_hz / rate_hz - 1) > 1e-6:
            raise RecordingError(
                path,
                value=f"samples at {format_si(rate_hz, 'hz')}",
                expected=f"{format_si(frame.chirp.sample_rate_hz, 'hz')}, the"
                " radar.frame.chirp.sample_rate",
                fix="correct the settings",
            )
        n_samples = min(file.n_samples for file in files)
        n_frames = count_frames_with_pauses(path, frame, n_samples)
        radar, joined_findings = settings.radar, tuple[Finding, ...]()
        if frame.n_chirps_total == 1 and frame.period_s is None:
            n_chirps = n_frames
            radar, joined_findings = join_single_chirps(settings.radar, n_chirps)
            radar, n_frames, frame_findings = divide_chirps_into_frames(path, radar, n_chirps)
            frame, joined_findings = radar.frame, (*joined_findings, *frame_findings)
        iq = (hints.iq or "iq") if sampling == "complex" else None

        def decode(index: int, out: np.ndarray) -> None:
            _decode_chirps(files, chirp_start_samples(frame, index)[: len(out)], iq, out)

        findings = [
            *settings.findings,
            *joined_findings,
            *(note for file in files for note in file.findings),
        ]
        if iq is not None:
            sampled_chirps = np.empty(
                (min(frame.n_chirps_total, _MAX_SAMPLED_CHIRPS), 1, frame.chirp.n_samples),
                np.complex64,
            )
            decode(0, sampled_chirps)
            findings += negative_beat_frequency_findings(sampled_chirps, iq)
        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            start_offsets=chirp_start_offsets(frame, n_frames),
            findings=(*findings, *_assumed_start_and_length_findings(files, frame)),
            iq=iq,
        )


def _open_files_of_recording(path: Path, *, is_complex: bool) -> tuple[Wav, ...]:
    """Return the file of the recording, or those of I and of Q.

    Raises
    ------
    RecordingError
        If the channels do not fit real or complex samples, or a file of a pair is missing.
    """
    wav = parse_wav_header(path)
    other = other_iq_file(path) if wav.n_channels == 1 else None
    n_channels = 2 if other is not None else wav.n_channels
    if n_channels != (2 if is_complex else 1):
        names = iq_file_names(path.name) or {"i": f"{path.stem}_I.wav", "q": f"{path.stem}_Q.wav"}
        held = f"two files, {path.name} and {other.name}" if other else f"{n_channels} channels"
        raise RecordingError(
            path,
            value=f"{held}, and {'complex' if is_complex else 'real'} samples in the settings",
            expected=f"I and Q: {names['i']} and {names['q']} in one folder, or two channels"
            if is_complex
            else "one channel of real samples",
            fix="copy both files to one folder, or correct radar.frame.chirp.sampling"
            if is_complex
            else "set radar.frame.chirp.sampling to complex for I and Q, or give --format sync-wav"
            " for a beat signal and its sync",
        )
    if other is None:
        return (wav,)
    other_wav = parse_wav_header(other)
    if (other_wav.n_channels, other_wav.sample_rate_hz) != (1, wav.sample_rate_hz):
        raise RecordingError(
            other,
            value=f"{other_wav.n_channels} channels, sampled at"
            f" {format_si(other_wav.sample_rate_hz, 'hz')}",
            expected=f"one channel at {format_si(wav.sample_rate_hz, 'hz')}, as in {path.name}",
            fix="copy both files of the recording to one folder",
        )
    return (wav, other_wav) if path.name == iq_file_names(path.name)["i"] else (other_wav, wav)


def _decode_chirps(
    files: Sequence[Wav], chirp_starts: np.ndarray, iq: Iq | None, out: np.ndarray
) -> None:
    """Fill (chirp, 1, sample) with the chirps that begin at these samples."""
    first = int(chirp_starts[0])
    n_samples = int(chirp_starts[-1]) - first + out.shape[-1]
    channels = np.concatenate([file.read_samples(first, n_samples) for file in files], axis=1)
    if not np.isfinite(channels).all():
        raise RecordingError(
            files[0].path,
            value=f"non-finite samples between {first} and {first + n_samples}",
            expected="finite numbers (no NaN, no infinity)",
            fix="record it again",
        )
    chirps = sliding_window_view(channels, out.shape[-1], axis=0)
    if iq is None:
        out[:] = chirps[chirp_starts - first]
        return
    parts = np.moveaxis(chirps[chirp_starts - first], 1, 0)
    out[:, 0].real, out[:, 0].imag = parts if iq == "iq" else parts[::-1]


def _assumed_start_and_length_findings(files: Sequence[Wav], frame: Frame) -> tuple[Finding, ...]:
    """Report the assumed start of the chirps, and files of different length."""
    interval_s = frame.for_frame(0).single_interval_s
    findings = [
        Finding(
            level="note",
            setting="recording",
            value="no sync: the first chirp is assumed to begin with the file, the others every"
            f" {format_si(interval_s, 's')} after it (radar.frame.interval)",
            expected="a recording that starts with a ramp",
            fix="if it starts later, add the delay to radar.frame.chirp.adc_start and"
            " radar.frame.interval stays",
        )
    ]
    lengths = [file.n_samples for file in files]
    if len(set(lengths)) > 1:
        findings.append(
            Finding(
                level="warning",
                setting="recording",
                value=f"{lengths[0]} samples of I and {lengths[1]} of Q; the rest is left out",
                expected="I and Q of equal length",
                fix="no action needed if the recorder stopped them one after the other",
            )
        )
    return tuple(findings)
