"""Raw int16 samples: frames, gaps and word order, inferred from settings and samples."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.compiled_kernels import plain_twins_for_small_work
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, RecordingHints
from dechirp.recordings.samples.continuous import chirps_left_out_note
from dechirp.recordings.samples.iq_order import guess_iq_order, negative_beat_frequency_findings
from dechirp.recordings.samples.layouts import FourLanes, Layout, Pairs, SampleCode, TwoLanes
from dechirp.recordings.samples.sample_order import choose_sample_order, spectral_concentration
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings_lookup import assumed_single_receiver_findings
from dechirp.recordings.streams.byte_sources import ByteSource

_BLOCK_BYTES = 2**19  # decoded before the bytes leave the cache of a core
_MAX_GUESS_CHIRPS = 64  # chirps; more add only time
_MIN_GUESS_FRAMES = 8  # frames, of which chirps are used if there are as many


def interpret_raw_samples(
    path: Path,
    stream: ByteSource,
    layouts: Sequence[Layout],
    settings: RecordingSettings,
    hints: RecordingHints,
    *,
    offset_binary: bool = False,
    format_iq: Iq | None = None,
) -> Contents:
    """Interpret raw samples: everything but their order comes from the settings.

    Of several layouts, the one that concentrates the energy in the fewest beat frequencies is used;
    words in a wrong order spread it. `format_iq` is the order of I and Q that the format defines,
    for settings that do not; without either, it is guessed.

    Raises
    ------
    RecordingError
        If the bytes fit no layout.
    """
    interpretations, errors = [], []
    for layout in layouts:
        code = SampleCode(bits=settings.bits, offset_binary=offset_binary)
        try:
            interpretations.append(_interpret_with_layout(path, stream, layout, code, settings))
        except RecordingError as error:
            errors.append(error)
    if not interpretations:
        raise errors[0]
    concentrations = [
        spectral_concentration(interpretation.decode_first_chirps_without_gaps())
        for interpretation in interpretations
    ]
    best_index, order_findings = choose_sample_order(
        [interpretation.layout.name for interpretation in interpretations],
        concentrations,
        n_samples=settings.radar.frame.chirp.n_samples,
        setting="layout",
        fix="give --device, or the settings file of the vendor",
    )
    best = interpretations[best_index]
    findings = (
        best.settings.findings
        + assumed_single_receiver_findings(settings)
        + _lost_frames_and_gaps_findings(stream, best)
        + order_findings
    )
    iq, n_slots = hints.iq or settings.iq or format_iq, best.radar.frame.n_slots
    if best.radar.frame.chirp.sampling == "real":
        iq = None
    elif iq is None:
        iq, guess_finding = guess_iq_order(best.decode_spread_chirps(), n_slots=n_slots)
        findings += (guess_finding,)
        best = replace(best, code=replace(best.code, iq=iq))
    else:
        best = replace(best, code=replace(best.code, iq=iq))
        findings += negative_beat_frequency_findings(
            best.decode_spread_chirps(), iq, n_slots=n_slots
        )
    return Contents(
        radar=best.radar,
        n_frames=best.n_frames,
        decode=best.decode_frame,
        decode_frames=best.decode_frames if best.has_whole_frames else None,
        gaps=best.lost_chirp_mask(),
        findings=findings,
        scale=best.code.step_relative_to_full_scale,
        device=settings.device,
        iq=iq,
        settings_path=settings.path,
        concentration=concentrations[best_index],
    )


def count_frame_bytes(layout: Layout, settings: RecordingSettings) -> int:
    """Return the bytes of a frame with all its sub-frames."""
    radars = [sub_frame.radar for sub_frame in settings.sub_frames]
    if radars:
        radars[settings.sub_frame_index] = settings.radar
    return sum(_count_chirp_bytes(layout, radar) for radar in radars or [settings.radar])


def _count_chirp_bytes(layout: Layout, radar: Radar) -> int:
    """Return the bytes of all chirps of a radar in a frame."""
    words = layout.words_per_chirp(radar.frame.chirp, radar.array.n_rx)
    return 2 * words * radar.frame.n_chirps_total


@frozen_dataclass
class _Interpretation:
    """One interpretation of the bytes: layout, code and settings."""

    stream: ByteSource
    layout: Layout
    code: SampleCode
    settings: RecordingSettings
    n_frames: int
    first_frame: int
    """First frame of which any byte arrived."""

    @property
    def radar(self) -> Radar:
        return self.settings.radar

    @property
    def bytes_per_chirp(self) -> int:
        return 2 * self.layout.words_per_chirp(self.radar.frame.chirp, self.radar.array.n_rx)

    @property
    def bytes_per_frame(self) -> int:
        return count_frame_bytes(self.layout, self.settings)

    @property
    def first_frame_byte_offset(self) -> int:
        """Offset of the first frame in bytes, or of the sub-frame in it."""
        earlier = self.settings.sub_frames[: self.settings.sub_frame_index]
        return self.first_frame * self.bytes_per_frame + sum(
            _count_chirp_bytes(self.layout, sub_frame.radar) for sub_frame in earlier
        )

    def decode_first_chirps_without_gaps(self) -> np.ndarray:
        """Return (chirp, rx, sample) of a frame: enough chirps to distinguish echoes from noise.

        The first frame without gaps is used: lost samples, which are zero, are no evidence.
        """
        frame, gaps = self.radar.frame, self.lost_chirp_mask()
        n_chirps = min(frame.n_chirps_total, _MAX_GUESS_CHIRPS)
        # Without a complete frame, the one with the fewest gaps.
        index = 0 if gaps is None else int(np.argmin(gaps[:, :n_chirps].sum(axis=1)))
        shape = (n_chirps, self.radar.array.n_rx, frame.chirp.n_samples)
        samples = np.empty(shape, np.complex64 if frame.chirp.sampling == "complex" else np.float32)
        with plain_twins_for_small_work(samples.size):
            self.decode_frame(index, samples)
        return samples

    def decode_spread_chirps(self) -> np.ndarray:
        """Return (chirp, rx, sample) of whole rounds from frames all over the recording.

        Echoes that are at rest within a frame may move between frames. Frames with gaps are left
        out if others exist.
        """
        frame, gaps = self.radar.frame, self.lost_chirp_mask()
        usable = np.arange(self.n_frames)
        if gaps is not None:
            n_lost = gaps.sum(axis=1)
            usable = np.flatnonzero(n_lost == n_lost.min())
        n_rounds = max(1, _MAX_GUESS_CHIRPS // frame.n_slots)
        n_selected = min(usable.size, max(_MIN_GUESS_FRAMES, n_rounds // frame.n_chirps), n_rounds)
        selected = usable[np.linspace(0, usable.size - 1, n_selected).astype(int)]
        n_chirps = min(frame.n_chirps, n_rounds // n_selected) * frame.n_slots
        shape = (n_selected, n_chirps, self.radar.array.n_rx, frame.chirp.n_samples)
        samples = np.empty(shape, np.complex64 if frame.chirp.sampling == "complex" else np.float32)
        with plain_twins_for_small_work(samples.size):
            for index, frame_samples in zip(selected.tolist(), samples, strict=True):
                self.decode_frame(index, frame_samples)
        return samples.reshape(-1, *shape[2:])

    def decode_frame(self, frame_index: int, out: np.ndarray) -> None:
        """Fill (chirp, rx, sample) with one frame, or with whole frames from this one on."""
        size = self.bytes_per_chirp
        start = self.first_frame_byte_offset + frame_index * self.bytes_per_frame
        per_block = max(1, _BLOCK_BYTES // size)
        block = np.empty((min(per_block, len(out)), size), np.uint8)
        for first in range(0, len(out), per_block):
            part = out[first : first + per_block]
            chirp_bytes = block[: len(part)]
            self.stream.read(start + first * size, chirp_bytes.reshape(-1))
            self.layout.decode(chirp_bytes.view("<i2"), part, self.code)

    @property
    def has_whole_frames(self) -> bool:
        """Return whether the chirps of a frame follow those of the frame before, in all bytes."""
        return self.bytes_per_frame == self.bytes_per_chirp * self.radar.frame.n_chirps_total

    def decode_frames(self, first_frame: int, out: np.ndarray) -> None:
        """Fill (frame, chirp, rx, sample) with consecutive whole frames."""
        self.decode_frame(first_frame, out.reshape(-1, *out.shape[2:]))

    def lost_chirp_mask(self) -> np.ndarray | None:
        """Return (frame, chirp), True where bytes of the chirp were lost; None without losses."""
        lost_ranges = self.stream.lost_byte_ranges
        n_sent = self.radar.frame.n_chirps_total
        first_of, last_of = lost_ranges[:, 0], lost_ranges[:, 1] - 1
        frames, within = divmod(first_of - self.first_frame_byte_offset, self.bytes_per_frame)
        # A loss that begins in a later sub-frame reaches this one in the next frame.
        first = frames * n_sent + np.minimum(within // self.bytes_per_chirp, n_sent)
        frames, within = divmod(last_of - self.first_frame_byte_offset, self.bytes_per_frame)
        last = frames * n_sent + np.minimum(within // self.bytes_per_chirp, n_sent - 1)
        # +1 where a gap begins and -1 after it: inside gaps the running sum is positive.
        steps = np.zeros(self.n_frames * n_sent + 1, np.int64)
        inside = (last >= 0) & (first < steps.size - 1) & (first <= last)
        np.add.at(steps, np.maximum(first[inside], 0), 1)
        np.add.at(steps, np.minimum(last[inside] + 1, steps.size - 1), -1)
        gaps = np.cumsum(steps[:-1]) > 0
        return gaps.reshape(self.n_frames, n_sent) if gaps.any() else None


def check_receivers_can_alternate(path: Path, settings: RecordingSettings) -> None:
    """Raise `RecordingError` if the settings exclude alternating receivers."""
    if settings.is_interleaved is False:
        raise RecordingError(
            path,
            value="one receiver after the other in the settings",
            expected="alternating receivers, as in this format",
            fix="give --format dca1000, or correct the settings",
        )


def _interpret_with_layout(
    path: Path, stream: ByteSource, layout: Layout, code: SampleCode, settings: RecordingSettings
) -> _Interpretation:
    """Interpret the bytes with a layout; raise `RecordingError` if they do not fit."""
    chirp = settings.radar.frame.chirp
    if isinstance(layout, TwoLanes) and chirp.sampling == "complex" and chirp.n_samples % 2:
        raise RecordingError(
            path,
            value=f"chirps of {chirp.n_samples} complex samples in the settings",
            expected="an even number of complex samples: the format stores groups of two",
            fix="correct radar.frame.chirp.n_samples",
        )
    # Positions beyond those of a sample belong to the next sample.
    if isinstance(layout, FourLanes | Pairs) and max(layout.receivers) >= layout.n_present:
        raise RecordingError(
            path,
            value=f"{settings.radar.array.n_rx} receivers in the settings, up to number"
            f" {max(layout.receivers) + 1} of the chip",
            expected=f"at most {layout.n_present} receivers: {layout.name}",
            fix="correct radar.array.rx, or the device",
        )
    settings, first_frame, n_frames = _locate_first_frame_and_count_frames(
        path, stream, layout, settings
    )
    return _Interpretation(
        stream=stream,
        layout=layout,
        code=code,
        settings=settings,
        n_frames=n_frames,
        first_frame=first_frame,
    )


def _locate_first_frame_and_count_frames(
    path: Path, stream: ByteSource, layout: Layout, settings: RecordingSettings
) -> tuple[RecordingSettings, int, int]:
    """Return the settings, the first frame and the number of frames; warn of a cut last frame."""
    frame, n_rx = settings.radar.frame, settings.radar.array.n_rx
    chirp_bytes = 2 * layout.words_per_chirp(frame.chirp, n_rx)
    frame_bytes = count_frame_bytes(layout, settings)
    lost_ranges = stream.lost_byte_ranges
    # A capture started during a measurement begins with frames of which no byte arrived.
    leading_bytes = int(lost_ranges[0, 1]) if len(lost_ranges) and lost_ranges[0, 0] == 0 else 0
    first_frame = leading_bytes // frame_bytes
    size = stream.n_bytes - first_frame * frame_bytes
    n_frames, rest = divmod(size, frame_bytes)
    expected_frames = settings.n_frames
    frame_text = (
        f"{frame_bytes} bytes a frame ({frame.n_chirps_total} chirps of {chirp_bytes} bytes:"
        f" {n_rx} receivers, {frame.chirp.n_samples} {frame.chirp.sampling} samples,"
        f" {layout.name}"
        f"{'; and other sub-frames' if settings.sub_frames else ''})"
        f"{'' if settings.path is None else f', according to {settings.path.name}'}"
    )
    # A capture that stopped early ends with a whole network packet, 182 groups of 8 bytes.
    # It can be shorter than the transmitted data, but never longer.
    if settings.has_merged_frames and not n_frames and not size % 8 and size >= 2 * chirp_bytes:
        n_chirps, rest = divmod(size, chirp_bytes)
        shorter_radar = replace(
            settings.radar, frame=replace(frame, n_chirps=n_chirps // frame.n_slots)
        )
        found_text = f"{n_chirps} complete chirps and {rest} bytes"
        return (
            _add_cut_short_warning(
                replace(settings, radar=shorter_radar), size, value=found_text, expected=frame_text
            ),
            0,
            1,
        )
    # Merged frames of one chirp may leave some over.
    n_left, rest_of_chirp = divmod(rest, chirp_bytes)
    if settings.has_merged_frames and n_frames and n_left and not rest_of_chirp:
        settings = settings.with_findings(chirps_left_out_note(n_frames, frame, n_left))
        size, rest = size - rest, 0
    round_bytes = chirp_bytes * frame.n_slots
    n_rounds, rest_of_round = divmod(size, round_bytes)
    if n_frames < 1 and n_rounds and not (settings.sub_frames or size % 8 or rest_of_round):
        warning = _shorter_frame_note(n_rounds, size, frame_text)
        shorter_radar = replace(settings.radar, frame=replace(frame, n_chirps=n_rounds))
        return replace(settings, radar=shorter_radar).with_findings(warning), first_frame, 1
    if n_frames < 1 or (expected_frames is not None and size > expected_frames * frame_bytes):
        expected = (
            f"at least {frame_bytes}"
            if expected_frames is None
            else f"{expected_frames * frame_bytes}"
        )
        shorter = (
            f", or shorter frames: --set radar.frame.n_chirps={n_rounds}"
            if n_frames < 1 and n_rounds and not settings.sub_frames
            else ""
        )
        raise RecordingError(
            path,
            value=f"{size} bytes",
            expected=f"{expected} bytes, a multiple of 8: {frame_text}",
            fix=f"copy the whole file again, or give its settings: --radar FILE{shorter}",
        )
    if not rest and expected_frames in (None, n_frames):
        return settings, first_frame, n_frames
    frames_text = format_count_with_noun(n_frames, "complete frame")
    found_text = f"{frames_text} and {format_count_with_noun(rest, 'byte')}"
    expected_text = f"complete frames, {frame_text}" + (
        f", {expected_frames} of them" if expected_frames else ""
    )
    return (
        _add_cut_short_warning(settings, size, value=found_text, expected=expected_text),
        first_frame,
        n_frames,
    )


def _shorter_frame_note(n_chirps: int, n_bytes: int, frame_text: str) -> Finding:
    """Return the note that the recording is read as one frame of fewer chirps."""
    return Finding(
        level="note",
        setting="radar.frame.n_chirps",
        value=f"chosen --set radar.frame.n_chirps={n_chirps} because the recording has only"
        f" {n_bytes} bytes: one frame of fewer chirps",
        expected=f"at least one whole frame, {frame_text}",
        fix="copy the whole file again, or give its settings: --radar FILE",
    )


def _add_cut_short_warning(
    settings: RecordingSettings, n_bytes: int, *, value: str, expected: str
) -> RecordingSettings:
    """Add the warning that the recording is cut short."""
    warning = Finding(
        level="warning",
        setting="recording",
        value=f"{n_bytes} bytes, cut short: {value} left out",
        expected=expected,
        fix="if more than the end is missing, the settings are not those of this recording",
    )
    return replace(settings, findings=(*settings.findings, warning))


def _lost_frames_and_gaps_findings(
    stream: ByteSource, interpretation: _Interpretation
) -> tuple[Finding, ...]:
    """Report frames that were not captured, and gaps."""
    gaps = interpretation.lost_chirp_mask()
    findings = []
    if interpretation.first_frame:
        findings.append(
            Finding(
                level="note",
                setting="recording",
                value=f"the first {interpretation.first_frame} frames not captured",
                expected="a capture that starts with the measurement",
                fix="no action needed: frames are counted from the first one captured",
            )
        )
    if gaps is not None:
        frames = np.flatnonzero(gaps.any(axis=1))
        # Other findings report losses before the first and after the last frame.
        start = interpretation.first_frame * interpretation.bytes_per_frame
        end = start + len(gaps) * interpretation.bytes_per_frame
        lost_ranges = np.clip(stream.lost_byte_ranges, start, end)
        lost_ranges = lost_ranges[lost_ranges[:, 1] > lost_ranges[:, 0]]
        n_bytes = int(np.sum(lost_ranges[:, 1] - lost_ranges[:, 0]))
        findings.append(
            Finding(
                level="warning",
                setting="recording",
                value=f"{n_bytes} bytes lost in {len(lost_ranges)} ranges: {gaps.sum()} of"
                f" {gaps.size} chirps have gaps, in {format_number_ranges('frame', frames)}",
                expected="every packet that the radar sent",
                fix="leave those frames out, or record again with a longer packet delay; the lost"
                " samples are zero, and the cube's coordinate `gap` marks their chirps",
            )
        )
    return tuple(findings)
