"""Stereo WAV radars ("coffee can"): the beat signal, and beside it the sync of the ramps.

Channel 1 is the beat signal, channel 2 a square wave that is high during each up-ramp. Sound
cards invert both, which is undone (`encoding` inverted, the default); `upright` takes them as
they are. A chirp begins where the sync rises.

The sync of a triangular radar is high for half of the time, so the polarity that is not chosen
gives the down-ramps: this is how to read them. Their beat frequencies are as good, but moving
targets have the opposite range-Doppler coupling and velocities the opposite sign.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.samples.continuous import against_interval, must_be_single, whole_frames
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.riff import Wav, looks_like_wav, wav

_BLOCK = 2**18
_LOOKED_AT = 2**20
_BEAT, _SYNC = 0, 1


@value
class SyncWav(Format):
    """Stereo WAV radars: beat signal, and sync of the ramps.

    One file; chirps follow one another without frames, which the radar's settings make.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding",)
    encodings: ClassVar[tuple[str, ...]] = ("inverted", "upright")

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            return Fit.CONTAINER if looks_like_wav(file.read(12)) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        sign = 1 if told.encoding == "upright" else -1
        sound = wav(path)
        settings = settings_for(path, told)
        must_be_single(path, settings.radar, "real")
        chirp = settings.radar.frame.chirp
        rate_hz = sound.sample_rate_hz
        if sound.n_channels != 2 or abs(chirp.sample_rate_hz / rate_hz - 1) > 1e-6:
            raise RecordingError(
                path,
                got=f"of {sound.n_channels} channels, sampled at {rate_hz} Hz",
                need="of 2 channels, the beat signal and its sync, sampled at"
                f" {chirp.sample_rate_hz:.6g} Hz as radar.frame.chirp.sample_rate says",
                fix="Correct the settings, or record both channels.",
            )
        delay = round(chirp.adc_start_s * rate_hz)
        ramps = _ramps(sound, sign, delay + chirp.n_samples)
        radar, n_frames, left = whole_frames(path, settings.radar, len(ramps.starts))
        n_chirps = radar.frame.n_sent
        used = ramps.starts[: n_frames * n_chirps].reshape(n_frames, n_chirps)
        findings = settings.findings + sound.findings + left + ramps.findings
        if told.encoding is None:
            findings += (_assumed(),)
        if ramps.interval_s is not None:
            findings += against_interval(radar.frame, ramps.interval_s, by="the sync")

        def decode(index: int, out: np.ndarray) -> None:
            for place, start in enumerate(used[index].tolist()):
                if start < 0:
                    out[place] = 0
                    continue
                samples = sound.read(start + delay, chirp.n_samples)[:, _BEAT]
                if not np.isfinite(samples).all():
                    raise RecordingError(
                        path,
                        got=f"a recording with samples that are not finite in chirp {place} of"
                        f" frame {index}",
                        need="finite numbers (no NaN, no infinity)",
                        fix="Record it again.",
                    )
                np.multiply(samples, np.float32(sign), out=out[place, 0])

        missing = used < 0
        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            gaps=missing if missing.any() else None,
            findings=findings,
        )


@value
class _Ramps:
    """Where the ramps of a recording begin."""

    starts: np.ndarray
    """(chirp,) int64: first sample of each, -1 where its sync is missing."""
    interval_s: float | None
    """Mean time from ramp to ramp; None where there is one alone."""
    findings: tuple[Finding, ...] = ()


def _ramps(sound: Wav, sign: int, n_needed: int) -> _Ramps:
    """Find the ramps by their sync; those that are missing get a place of their own.

    Raises
    ------
    RecordingError
        If there is no sync, or it is mostly high for less than `n_needed` samples.
    """
    low, high = _levels(sound, sign)
    middle, half = (low + high) / 2, (high - low) / 4
    if not half > 0:
        raise _no_ramps(sound, n_needed, f"a sync (channel 2) that stays at {low:.3g}")
    found, n_short, n_high = [], 0, 0
    for starts, lengths in _high(sound, sign, middle - half, middle + half, n_needed):
        long = lengths >= n_needed
        found.append(starts[long])
        n_short += int(np.count_nonzero(~long))
        n_high += int(lengths.sum())
    starts = np.concatenate(found)
    if len(starts) <= n_short:
        n_pulses = len(starts) + n_short
        raise _no_ramps(
            sound,
            n_needed,
            f"a sync (channel 2) that is high {n_pulses} times, for {n_high / max(n_pulses, 1):.6g}"
            " samples on average",
        )
    return _in_order(starts, n_short, sound.sample_rate_hz)


def _levels(sound: Wav, sign: int) -> tuple[float, float]:
    """Low and high level of the sync; a thousandth of the samples may lie outside."""
    rng = np.random.default_rng(1)  # not every k-th: that could keep step with the sync
    share = min(1.0, _LOOKED_AT / sound.n_samples)
    some = [
        rng.choice(block, math.ceil(share * block.size), replace=False) if share < 1 else block
        for _, block in _sync(sound, sign)
    ]
    low, high = np.quantile(np.concatenate(some).astype(float), [0.001, 0.999])
    return float(low), float(high)


def _sync(sound: Wav, sign: int) -> Iterator[tuple[int, np.ndarray]]:
    """The sync channel, a block at a time, with the place of its first sample."""
    for first in range(0, sound.n_samples, _BLOCK):
        block = sound.read(first, min(_BLOCK, sound.n_samples - first))[:, _SYNC]
        yield first, np.where(np.isfinite(block), block, np.float32(0)) * np.float32(sign)


def _high(
    sound: Wav, sign: int, lower: float, upper: float, n_needed: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Start and length of the times in which the sync is high, a block at a time.

    It is high from where it exceeds `upper` until it is below `lower`: noise smaller than
    half of its amplitude makes no edges. A last time that the end of the recording cuts short
    counts if `n_needed` samples of it are there.
    """
    begun, state = -1, 0  # of the last change: where, and to what
    for first, block in _sync(sound, sign):
        level = (block > upper).astype(np.int8) - (block < lower)
        places = np.flatnonzero(level)
        levels = level[places]
        changed = levels != np.concatenate([[state], levels])[:-1]
        at = np.concatenate([[begun], first + places[changed]])
        to = np.concatenate([[state], levels[changed]])
        if state == 0 and len(at) > 1:
            at[1] = -1  # where the recording begins, not the ramp
        high = (to[:-1] > 0) & (at[:-1] >= 0)
        yield at[:-1][high], np.diff(at)[high]
        begun, state = int(at[-1]), int(to[-1])
    if state > 0 and 0 <= begun <= sound.n_samples - n_needed:
        yield np.array([begun]), np.array([sound.n_samples - begun])


def _in_order(starts: np.ndarray, n_short: int, sample_rate_hz: float) -> _Ramps:
    """Put each ramp in its place, with places left for those that are missing."""
    if len(starts) == 1:
        return _Ramps(starts=starts, interval_s=None)
    steps = np.diff(starts)
    usual = float(np.median(steps))
    turns = np.maximum(np.rint(steps / usual).astype(np.int64), 1)
    places = np.concatenate([[0], np.cumsum(turns)])
    in_order = np.full(int(places[-1]) + 1, -1, np.int64)
    in_order[places] = starts
    # By one sample from ramp to ramp, where an interval is no whole number of samples.
    uneven = abs(steps - turns * usual) > max(0.01 * usual, 2)
    findings = []
    if (turns > 1).any() or uneven.any() or n_short:
        longest = int(np.argmax(steps))
        findings.append(
            Finding(
                level="warning",
                setting="recording",
                got=f"an irregular sync: {int((turns - 1).sum())} ramps missing,"
                f" {int(uneven.sum())} intervals off by more than 1 %, high for too short"
                f" {n_short} times; the longest interval, {steps[longest] / sample_rate_hz:.4g} s,"
                f" begins {starts[longest] / sample_rate_hz:.4g} s after the start",
                need=f"a ramp every {usual / sample_rate_hz:.6g} s",
                fix="Samples of missing ramps are zero, and marked as gaps: leave out those"
                " frames.",
            )
        )
    even = steps[(turns == 1) & ~uneven]
    return _Ramps(
        starts=in_order,
        interval_s=float(np.mean(even) if even.size else usual) / sample_rate_hz,
        findings=tuple(findings),
    )


def _no_ramps(sound: Wav, n_needed: int, got: str) -> RecordingError:
    return RecordingError(
        sound.path,
        got=got,
        need=f"a sync that is high for at least {n_needed} samples in most ramps, as"
        " radar.frame.chirp.n_samples and adc_start ask for",
        fix="Give fewer samples, or the other encoding (inverted or upright); or record the sync"
        " of the ramps in channel 2.",
    )


def _assumed() -> Finding:
    return Finding(
        level="note",
        setting="encoding",
        got="not given, taken as inverted, as sound cards do",
        need="the polarity of the sync, which tells up-ramps from down-ramps",
        fix="Give --encoding upright if nothing inverted the signals, or to read the down-ramps.",
    )
