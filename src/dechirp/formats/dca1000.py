"""TI DCA1000 captures (`.bin`) of xWR16xx, 18xx and 68xx chips: two lanes, no header.

Chirp after chirp, in each the receivers one after the other, in each the samples in groups
of four int16 (little endian) that hold two complex samples, `A0 A1 B0 B1`. A is the
in-phase part and B the quadrature part, or the other way round with the chip's iqSwap.

TI application report SWRA581, Mmwave Radar Device ADC Raw Data Capture.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings.read import find_settings, read_settings

_GROUP_BYTES = 8


@value
class Dca1000(Format):
    """Bare samples: everything but their order comes from the settings."""

    suffixes: ClassVar[tuple[str, ...]] = (".bin",)
    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by nothing in the content being of another kind; bare samples have no mark."""
        return Fit.POSSIBLE if path.is_file() and foreign(path) is None else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        settings = told.settings or read_settings(find_settings(path))
        radar = settings.radar
        if radar.frame.chirp.sampling != "complex" or radar.frame.chirp.n_samples % 2:
            raise RecordingError(
                path,
                got=f"said to hold chirps of {radar.frame.chirp.n_samples}"
                f" {radar.frame.chirp.sampling} samples",
                need="of an even number of complex samples, in which this format groups them",
                fix="Correct radar.frame.chirp.",
            )
        settings, n_frames = _frames(path, settings)
        radar = settings.radar
        shape = (
            n_frames,
            radar.frame.n_chirps,
            radar.array.n_rx,
            radar.frame.chirp.n_samples // 2,
            2,  # A, B
            2,  # two samples
        )
        groups = np.memmap(path, dtype="<i2", mode="r", shape=shape)
        iq = told.iq or settings.iq or "iq"

        def frame(index: int) -> np.ndarray:
            return _decoded(groups[index], iq)

        findings = settings.findings
        if told.iq is None and settings.iq is None:
            findings += (_assumed_iq(),)
        # 64 chirps tell the sides of the spectrum apart; more would only take time.
        findings += _on_the_wrong_side(_decoded(groups[0, :64], iq), iq)
        return Contents(radar=radar, n_frames=n_frames, frame=frame, findings=findings, iq=iq)


def _decoded(groups: np.ndarray, iq: str) -> np.ndarray:
    """Make samples (..., sample) of groups (..., pair, A or B, two samples)."""
    a, b = groups[..., 0, :], groups[..., 1, :]
    samples = np.empty(a.shape, np.complex64)
    samples.real, samples.imag = (a, b) if iq == "iq" else (b, a)
    samples /= 32768
    return samples.reshape(*groups.shape[:-3], -1)


def _frames(path: Path, settings: Settings) -> tuple[Settings, int]:
    """Count the whole frames; the settings also say what of the file is left over."""
    frame, n_rx = settings.radar.frame, settings.radar.array.n_rx
    chirp_bytes = n_rx * frame.chirp.n_samples * 4
    frame_bytes = frame.n_chirps * chirp_bytes
    size = path.stat().st_size
    n_frames, rest = divmod(size, frame_bytes)
    told = settings.n_frames
    one_frame = (
        f"{frame_bytes} bytes a frame ({frame.n_chirps} chirps x {n_rx} receivers x"
        f" {frame.chirp.n_samples} samples x 4 bytes)"
    )
    # A capture that stopped early ends with a whole network packet, 182 groups of 8 bytes.
    # It can be shorter than what the radar sent, but never longer.
    if settings.merged and not n_frames and not size % _GROUP_BYTES and size >= 2 * chirp_bytes:
        n_chirps, rest = divmod(size, chirp_bytes)
        shorter = replace(settings.radar, frame=replace(frame, n_chirps=n_chirps))
        got = f"{n_chirps} whole chirps and {rest} bytes"
        return _with_cut(replace(settings, radar=shorter), size, got=got, need=one_frame), 1
    if n_frames < 1 or size % _GROUP_BYTES or (told is not None and size > told * frame_bytes):
        expected = f"at least {frame_bytes}" if told is None else f"{told * frame_bytes}"
        raise RecordingError(
            path,
            got=f"a file of {size} bytes",
            need=f"{expected} bytes, in whole groups of {_GROUP_BYTES}: {one_frame}",
            fix="Copy the whole file again, or give the settings it was recorded with.",
        )
    if not rest and told in (None, n_frames):
        return settings, n_frames
    got = f"{n_frames} whole frames and {rest} bytes"
    need = f"whole frames, {one_frame}" + (f", {told} of them" if told else "")
    return _with_cut(settings, size, got=got, need=need), n_frames


def _with_cut(settings: Settings, size: int, *, got: str, need: str) -> Settings:
    cut = Finding(
        level="warning",
        setting="recording",
        got=f"{size} bytes, cut short: {got} that are left out",
        need=need,
        fix="If more than the end is missing, the settings are not those of this recording.",
    )
    return replace(settings, findings=(*settings.findings, cut))


def _assumed_iq() -> Finding:
    return Finding(
        level="note",
        setting="iq",
        got="not given, taken as iq",
        need="the order in which the chip wrote the parts of a sample",
        fix="Give --iq iq or --iq qi.",
    )


def _on_the_wrong_side(chirps: np.ndarray, iq: str) -> tuple[Finding, ...]:
    """Warn if echoes lie at negative beat frequencies, where an up-chirp has none."""
    spectrum = np.fft.fft(chirps - chirps.mean(axis=-1, keepdims=True), axis=-1)
    energy = np.sum(np.abs(spectrum) ** 2, axis=(0, 1))
    half = energy.size // 2
    positive, negative = energy[1:half].sum(), energy[half + 1 :].sum()
    # Noise alone has equal sides, within 0.1 dB over 64 chirps; 6 dB is no chance.
    if negative <= 4 * positive:
        return ()
    return (
        Finding(
            level="warning",
            setting="iq",
            got=f"{iq}, with {negative / (positive + negative):.1%} of the energy at negative"
            " beat frequencies",
            need="echoes at positive beat frequencies, as an up-chirp gives",
            fix=f"Read it with --iq {'qi' if iq == 'iq' else 'iq'}.",
        ),
    )
