"""Bare int16 samples: frames, gaps and the order of words, found from settings and numbers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.spans import spans
from dechirp.core.values import value
from dechirp.formats.base import Contents, Told
from dechirp.formats.samples.iq_order import guess, on_the_wrong_side
from dechirp.formats.samples.layouts import Code, FourLanes, Layout, Pairs, TwoLanes
from dechirp.formats.samples.sample_order import choose, concentration
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings_for import untold_receivers
from dechirp.formats.streams.bytes_in import BytesIn
from dechirp.radar.radar import Radar

_BLOCK_BYTES = 2**19  # read and decoded before they leave the cache of a core
_LOOKED_AT = 64  # chirps; more would only take time


def bare_contents(
    path: Path,
    stream: BytesIn,
    layouts: Sequence[Layout],
    settings: Settings,
    told: Told,
    *,
    offset_binary: bool = False,
) -> Contents:
    """Contents of bare samples: everything but their order comes from the settings.

    Of several layouts, the one is taken that leaves the energy in the fewest beat
    frequencies; words sorted wrongly spread it.

    Raises
    ------
    RecordingError
        If the bytes fit no layout.
    """
    readings, refused = [], []
    for layout in layouts:
        code = Code(bits=settings.bits, offset_binary=offset_binary)
        try:
            readings.append(_reading(path, stream, layout, code, settings))
        except RecordingError as error:
            refused.append(error)
    if not readings:
        raise refused[0]
    concentrations = [concentration(reading.first_chirps()) for reading in readings]
    place, chosen = choose(
        [reading.layout.name for reading in readings],
        concentrations,
        n_samples=settings.radar.frame.chirp.n_samples,
        setting="layout",
        fix="give --device, or the settings file of the vendor.",
    )
    best = readings[place]
    findings = best.settings.findings + untold_receivers(settings) + _lost(stream, best) + chosen
    iq = told.iq or settings.iq
    if best.radar.frame.chirp.sampling == "real":
        iq = None
    elif iq is None:
        iq, guessed = guess(best.first_chirps())
        findings += (guessed,)
    if iq is not None:
        best = replace(best, code=replace(best.code, iq=iq))
        findings += on_the_wrong_side(best.first_chirps(), iq)
    return Contents(
        radar=best.radar,
        n_frames=best.n_frames,
        decode=best.decode,
        gaps=best.gaps(),
        findings=findings,
        scale=best.code.scale,
        device=settings.device,
        iq=iq,
        settings_path=settings.path,
        concentration=concentrations[place],
    )


@value
class _Reading:
    """One way to read the bytes."""

    stream: BytesIn
    layout: Layout
    code: Code
    settings: Settings
    n_frames: int
    first_frame: int
    """The first of which any byte arrived."""

    @property
    def radar(self) -> Radar:
        return self.settings.radar

    @property
    def chirp_bytes(self) -> int:
        return 2 * self.layout.chirp_words(self.radar.frame.chirp, self.radar.array.n_rx)

    @property
    def first_byte(self) -> int:
        """Of the first frame."""
        return self.first_frame * self.radar.frame.n_sent * self.chirp_bytes

    def first_chirps(self) -> np.ndarray:
        """(chirp, rx, sample) of a frame: enough of them to tell noise from echoes.

        Of the first frame whose chirps are whole: lost samples, which are zero, tell nothing.
        """
        frame, gaps = self.radar.frame, self.gaps()
        n_chirps = min(frame.n_sent, _LOOKED_AT)
        # Where no frame is whole, the one with the fewest gaps.
        index = 0 if gaps is None else int(np.argmin(gaps[:, :n_chirps].sum(axis=1)))
        shape = (n_chirps, self.radar.array.n_rx, frame.chirp.n_samples)
        samples = np.empty(shape, np.complex64 if frame.chirp.sampling == "complex" else np.float32)
        self.decode(index, samples)
        return samples

    def decode(self, index: int, out: np.ndarray) -> None:
        """Fill (chirp, rx, sample) with one frame."""
        size = self.chirp_bytes
        start = self.first_byte + index * self.radar.frame.n_sent * size
        per_block = max(1, _BLOCK_BYTES // size)
        block = np.empty((min(per_block, len(out)), size), np.uint8)
        for first in range(0, len(out), per_block):
            part = out[first : first + per_block]
            taken = block[: len(part)]
            self.stream.read(start + first * size, taken.reshape(-1))
            self.layout.decode(taken.view("<i2"), part, self.code)

    def gaps(self) -> np.ndarray | None:
        """(frame, chirp), True where bytes of the chirp were lost; none: nothing was."""
        lost = self.stream.lost
        n_sent = self.radar.frame.n_sent
        starts_at = self.first_frame * n_sent
        first = lost[:, 0] // self.chirp_bytes - starts_at
        last = (lost[:, 1] - 1) // self.chirp_bytes - starts_at
        # +1 where a gap begins and -1 after it: inside gaps the running sum is positive.
        steps = np.zeros(self.n_frames * n_sent + 1, np.int64)
        inside = (last >= 0) & (first < steps.size - 1)
        np.add.at(steps, np.maximum(first[inside], 0), 1)
        np.add.at(steps, np.minimum(last[inside] + 1, steps.size - 1), -1)
        gaps = np.cumsum(steps[:-1]) > 0
        return gaps.reshape(self.n_frames, n_sent) if gaps.any() else None


def must_alternate(path: Path, settings: Settings) -> None:
    """Raise `RecordingError` if the settings say that the receivers are not in turn."""
    if settings.interleaved is False:
        raise RecordingError(
            path,
            got="said to hold one receiver after the other",
            need="receivers in turn, which this format has",
            fix="Name its format (dca1000), or correct the settings.",
        )


def _reading(
    path: Path, stream: BytesIn, layout: Layout, code: Code, settings: Settings
) -> _Reading:
    chirp = settings.radar.frame.chirp
    if isinstance(layout, TwoLanes) and chirp.sampling == "complex" and chirp.n_samples % 2:
        raise RecordingError(
            path,
            got=f"said to hold chirps of {chirp.n_samples} complex samples",
            need="of an even number of complex samples, in which this format groups them",
            fix="Correct radar.frame.chirp.n_samples.",
        )
    # Beyond the places that a sample has lie those of the next one.
    if isinstance(layout, FourLanes | Pairs) and max(layout.receivers) >= layout.n_present:
        raise RecordingError(
            path,
            got=f"said to hold {settings.radar.array.n_rx} receivers, up to number"
            f" {max(layout.receivers) + 1} of the chip",
            need=f"of {layout.n_present} receivers at most: {layout.name}",
            fix="Correct radar.array.rx, or the device.",
        )
    settings, first_frame, n_frames = _frames(path, stream, layout, settings)
    return _Reading(
        stream=stream,
        layout=layout,
        code=code,
        settings=settings,
        n_frames=n_frames,
        first_frame=first_frame,
    )


def _frames(
    path: Path, stream: BytesIn, layout: Layout, settings: Settings
) -> tuple[Settings, int, int]:
    """First frame and number of frames; the settings also say what is left over."""
    frame, n_rx = settings.radar.frame, settings.radar.array.n_rx
    chirp_bytes = 2 * layout.chirp_words(frame.chirp, n_rx)
    frame_bytes = frame.n_sent * chirp_bytes
    lost = stream.lost
    # A capture that joined a running radar begins with frames of which nothing arrived.
    before = int(lost[0, 1]) if len(lost) and lost[0, 0] == 0 else 0
    first_frame = before // frame_bytes
    size = stream.n_bytes - first_frame * frame_bytes
    n_frames, rest = divmod(size, frame_bytes)
    told = settings.n_frames
    one_frame = (
        f"{frame_bytes} bytes a frame ({frame.n_sent} chirps of {chirp_bytes} bytes:"
        f" {n_rx} receivers, {frame.chirp.n_samples} {frame.chirp.sampling} samples,"
        f" {layout.name})"
    )
    # A capture that stopped early ends with a whole network packet, 182 groups of 8 bytes.
    # It can be shorter than what the radar sent, but never longer.
    if settings.merged and not n_frames and not size % 8 and size >= 2 * chirp_bytes:
        n_chirps, rest = divmod(size, chirp_bytes)
        shorter = replace(settings.radar, frame=replace(frame, n_chirps=n_chirps // frame.n_slots))
        got = f"{n_chirps} whole chirps and {rest} bytes"
        return _with_cut(replace(settings, radar=shorter), size, got=got, need=one_frame), 0, 1
    if n_frames < 1 or size % 8 or (told is not None and size > told * frame_bytes):
        expected = f"at least {frame_bytes}" if told is None else f"{told * frame_bytes}"
        raise RecordingError(
            path,
            got=f"of {size} bytes",
            need=f"{expected} bytes, in whole groups of 8: {one_frame}",
            fix="Copy the whole file again, or give the settings it was recorded with.",
        )
    if not rest and told in (None, n_frames):
        return settings, first_frame, n_frames
    got = f"{n_frames} whole frames and {rest} bytes"
    need = f"whole frames, {one_frame}" + (f", {told} of them" if told else "")
    return _with_cut(settings, size, got=got, need=need), first_frame, n_frames


def _with_cut(settings: Settings, size: int, *, got: str, need: str) -> Settings:
    cut = Finding(
        level="warning",
        setting="recording",
        got=f"{size} bytes, cut short: {got} that are left out",
        need=need,
        fix="If more than the end is missing, the settings are not those of this recording.",
    )
    return replace(settings, findings=(*settings.findings, cut))


def _lost(stream: BytesIn, reading: _Reading) -> tuple[Finding, ...]:
    """What the gaps cost, and where they are."""
    gaps = reading.gaps()
    found = []
    if reading.first_frame:
        found.append(
            Finding(
                level="note",
                setting="recording",
                got=f"the first {reading.first_frame} frames not captured",
                need="frames that arrived",
                fix="Nothing is to be done: frames are counted from the first one that arrived.",
            )
        )
    if gaps is not None:
        frames = np.flatnonzero(gaps.any(axis=1))
        # Parts before the first frame or behind the last are told elsewhere.
        end = reading.first_byte + gaps.size * reading.chirp_bytes
        lost = np.clip(stream.lost, reading.first_byte, end)
        lost = lost[lost[:, 1] > lost[:, 0]]
        n_bytes = int(np.sum(lost[:, 1] - lost[:, 0]))
        found.append(
            Finding(
                level="warning",
                setting="recording",
                got=f"{n_bytes} bytes lost in {len(lost)} places: {gaps.sum()} of"
                f" {gaps.size} chirps have gaps, in {spans('frame', frames)}",
                need="every packet that the radar sent",
                fix="The lost samples are zero, and the cube's coordinate `gap` marks their"
                " chirps; leave those frames out, or record again with a longer packet delay.",
            )
        )
    return tuple(found)
