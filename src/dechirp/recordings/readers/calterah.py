"""Calterah text: a file for each receiver, numbers of 32 bits with two samples, high half first.

The samples are real, chirp after chirp. The settings lie beside them in `.hxx` files, one for each
profile; file names may have its number, as `Pf1`. Without it, that profile is used in whose layout
the echoes are most concentrated in range and Doppler frequency.

Transmitters send at once, in Doppler sub-bands that no file names: they are recognised in
the samples, see `processing.ddma_recognition`.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import check_free_memory
from dechirp.core.text import join_names
from dechirp.core.values import frozen_dataclass
from dechirp.processing.ddma_recognition import RecognisedDdma, recognise_ddma
from dechirp.radar.array import Array
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    check_stays_in_folder,
)
from dechirp.recordings.settings.calterah_hxx import (
    CalterahProfile,
    is_calterah_hxx,
    read_calterah_profile,
)

_HEAD_BYTES = 4096
_MAX_SETTINGS_BYTES = 2**20
_BLOCK_BYTES = 2**17
_SEPARATORS = b" ,\t\r\n;"
_UNEXPECTED = b"x"
_CLASSES = bytes(
    ord(" ") if byte in _SEPARATORS else byte if byte in b"0123456789" else ord(_UNEXPECTED)
    for byte in range(256)
)
"""Translation to digits, blanks, and a letter for any other byte."""
_HEAD = re.compile(rb"\s*\d{1,10}(?:[,\s]+\d{1,10}){7,}")
_RECEIVER = re.compile(r"(?:rx|f\d+_)(\d+)", re.IGNORECASE)
_PROFILE = re.compile(r"(?:^|_|p)f(\d)(?=_)", re.IGNORECASE)
_FULL_SCALE = 2**15


@frozen_dataclass
class Calterah(Format):
    """Calterah: a text file for each receiver, with its `.hxx` settings.

    The folder, or one file of it for one receiver. Doppler division is recognised in the samples
    unless the radar is given.
    """

    def recognise(self, path: Path) -> MatchQuality:
        folder = path if path.is_dir() else path.parent
        files = [path] if path.is_file() else sorted(path.glob("*.txt"))
        if not files or not any(folder.glob("*.hxx")):
            return MatchQuality.NO
        has_numbers = any(_has_words(file) for file in files if file.is_file())
        return MatchQuality.SELF_DESCRIBING if has_numbers else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        files = _receiver_files(path)
        words = [_read_words(file) for file in files]
        n_words = min(len(column) for column in words)
        codes = np.stack([_split_words(column[:n_words]) for column in words])
        if hints.settings is not None:
            radar, findings = hints.settings.radar, hints.settings.findings
            if radar.array.n_rx != len(files) or radar.frame.chirp.sampling != "real":
                raise RecordingError(
                    path,
                    value=f"real samples of {len(files)} receivers",
                    expected=f"those of the radar: {radar.frame.chirp.sampling} samples of"
                    f" {radar.array.n_rx} receivers",
                    fix="correct the radar, or leave it out: the settings are beside the file",
                )
        else:
            profile, findings = _choose_profile(path, files, codes)
            radar, more = _recognised_radar(profile, files, codes)
            findings += more
        n_chirps, n_samples = radar.frame.n_chirps_total, radar.frame.chirp.n_samples
        n_frames, remainder = divmod(codes.shape[1], n_chirps * n_samples)
        if n_frames == 0:
            raise _too_short_error(path, n_words, n_chirps * n_samples // 2)
        if remainder > 2:  # the program appends one number
            findings += (_remainder_note(remainder),)
        cube = codes[:, : n_frames * n_chirps * n_samples].reshape(
            len(files), n_frames, n_chirps, n_samples
        )

        def decode(index: int, out: np.ndarray) -> None:
            np.multiply(cube[:, index].transpose(1, 0, 2), np.float32(1 / _FULL_SCALE), out=out)

        return Contents(
            radar=radar,
            n_frames=n_frames,
            decode=decode,
            findings=tuple(findings),
            scale=1 / _FULL_SCALE,
        )


def _receiver_files(path: Path) -> list[Path]:
    """Return the files of a recording in the order of its receivers."""
    if path.is_file():
        return [path]
    by_receiver: dict[int, list[Path]] = {}
    for file in sorted(path.glob("*.txt")):
        number = _RECEIVER.findall(file.name)
        if file.is_file() and number and _has_words(file):
            check_stays_in_folder(path, file)
            by_receiver.setdefault(int(number[-1][:4]), []).append(file)
    if not by_receiver:
        raise RecordingError(
            path,
            value="no file with the number of its receiver in its name",
            expected="names such as near_rx0.txt or adc_test_20260527115033_Pf0_Rx0.txt",
            fix="open one file, or rename them",
        )
    twice = [files for files in by_receiver.values() if len(files) > 1]
    if twice:
        raise RecordingError(
            path,
            value=f"several recordings: {join_names(file.name for file in twice[0])}",
            expected="one file for each receiver",
            fix="move each recording to a folder of its own, with the .hxx files",
        )
    return [by_receiver[number][0] for number in sorted(by_receiver)]


def _has_words(file: Path) -> bool:
    try:
        with file.open("rb") as stream:
            return _HEAD.match(stream.read(_HEAD_BYTES)) is not None
    except OSError:
        return False


def _read_words(file: Path) -> np.ndarray:
    """Return the numbers of a file, uint32."""
    n_bytes = file.stat().st_size
    check_free_memory(
        f"the numbers in {file.name}", needed_bytes=5 * n_bytes, fix="split it into shorter ones"
    )
    content = file.read_bytes()
    text = content.translate(_CLASSES)
    if _UNEXPECTED in text:
        raise _damaged_error(file, f"{chr(content[text.index(_UNEXPECTED)])!r} among numbers")
    numbers = np.fromstring(text, dtype=np.int64, sep=" ") if text.strip() else np.empty(0, int)
    largest = numbers.max(initial=0)  # numbers of 20 digits saturate
    if largest >= 10**10 or _has_long_number_with_leading_zero(text):
        raise _damaged_error(file, "a number of 11 digits")
    if largest >= 2**32:
        raise _damaged_error(file, f"{largest}")
    return numbers.astype(np.uint32)


def _has_long_number_with_leading_zero(text: bytes) -> bool:
    """Return whether a number has more than 10 digits, of which the first is zero.

    A plain search for eleven digits takes four times as long as the conversion, and whole files
    four times as long as blocks that fit into the cache.
    """
    starts = [0] if text.startswith(b"0") else []
    characters = np.frombuffer(text, np.uint8)
    for first in range(0, len(text), _BLOCK_BYTES):
        block = characters[first : first + _BLOCK_BYTES + 2]
        previous, digits, following = block[:-2], block[1:-1], block[2:]
        is_leading = (previous == ord(" ")) & (digits == ord("0")) & (following != ord(" "))
        starts += (np.flatnonzero(is_leading) + (first + 1)).tolist()
    words = (text[start : start + 11] for start in starts)
    return any(len(word) == 11 and word.isdigit() for word in words)


def _split_words(words: np.ndarray) -> np.ndarray:
    """Return the samples of words, high half first, int16."""
    return np.ascontiguousarray(words.astype(">u4").view(">i2"), dtype=np.int16)


class _Layout(NamedTuple):
    profile: CalterahProfile
    concentration: float


def _choose_profile(
    path: Path, files: Sequence[Path], codes: np.ndarray
) -> tuple[CalterahProfile, tuple[Finding, ...]]:
    """Return the profile of a recording, with a note on the choice.

    Raises
    ------
    RecordingError
        If no settings can be read, or the recording is shorter than a frame of each.
    """
    folder = path if path.is_dir() else path.parent
    profiles, errors = [], []
    for file in sorted(folder.glob("*.hxx")):
        check_stays_in_folder(folder, file)
        with file.open("rb") as stream:
            text = stream.read(_MAX_SETTINGS_BYTES).decode("utf-8", errors="replace")
        if is_calterah_hxx(text):
            try:
                profiles.append(read_calterah_profile(file, text))
            except DechirpError as error:
                errors.append(error)
    if not profiles:
        if errors:
            raise errors[0]
        raise RecordingError(
            path,
            value="no .hxx file with Calterah's settings",
            expected="the settings of the recording beside it",
            fix="copy them there, or give the radar",
        )
    number = _PROFILE.findall(files[0].name)
    named = [profile for profile in profiles if number and profile.path.stem.endswith(number[-1])]
    fitting = [profile for profile in named or profiles if 2 * profile.n_words <= codes.shape[1]]
    if not fitting:
        shortest = min(profile.n_words for profile in named or profiles)
        raise _too_short_error(path, codes.shape[1] // 2, shortest)
    concentrations = {
        shape: _echo_concentration(codes, *shape) for shape in {*map(_frame_shape, fitting)}
    }
    layouts = [_Layout(profile, concentrations[_frame_shape(profile)]) for profile in fitting]
    best = max(layouts, key=lambda layout: layout.concentration)
    ties = [
        layout.profile.path.name
        for layout in layouts
        if layout.concentration == best.concentration and layout is not best
    ]
    reason = "by its name" if named else "whose chirps concentrate the echoes most"
    if ties:
        reason += f"; {join_names(ties)} would read the same samples"
    note = Finding(
        level="warning" if ties else "note",
        setting="radar",
        value=f"settings of {best.profile.path.name}, {reason}",
        expected="the profile of the recording",
        fix="give --radar with another .hxx file of the folder if they are wrong",
    )
    return best.profile, (note,)


def _frame_shape(profile: CalterahProfile) -> tuple[int, int]:
    """Return the numbers of chirps and of samples, on which alone the concentration depends."""
    return profile.frame.n_chirps, profile.frame.chirp.n_samples


def _echo_concentration(codes: np.ndarray, n_chirps: int, n_samples: int) -> float:
    """Return the sum of squared powers over the squared sum, of one frame in range and Doppler."""
    import scipy  # unused where another format is opened

    windows = [np.hanning(n).astype(np.float32) for n in (n_chirps, n_samples)]
    power = np.zeros((n_chirps, n_samples // 2 + 1))
    for receiver_codes in codes[:, : n_chirps * n_samples]:  # one at a time fits into the cache
        chirps = receiver_codes.reshape(n_chirps, n_samples).astype(np.float32)
        chirps -= chirps.mean(axis=-1, keepdims=True)
        chirps *= windows[1]
        # SciPy transforms several series at once: a quarter of the time of NumPy.
        ranges = scipy.fft.rfft(chirps, axis=-1)
        ranges *= windows[0][:, None]
        spectrum = scipy.fft.fft(ranges, axis=0, overwrite_x=True)
        power += spectrum.real**2 + spectrum.imag**2
    return float(np.sum(power**2) / max(np.sum(power) ** 2, np.finfo(float).tiny))


def _recognised_radar(
    profile: CalterahProfile, files: Sequence[Path], codes: np.ndarray
) -> tuple[Radar, tuple[Finding, ...]]:
    """Return the radar with the multiplexing that its samples show."""
    frame = profile.frame
    receivers = [int(number[-1]) for file in files if (number := _RECEIVER.findall(file.name))]
    rx_m = profile.array.rx_m
    if len(receivers) == len(files) and max(receivers) < len(rx_m):
        rx_m = tuple(rx_m[number] for number in receivers)
    else:
        rx_m = rx_m[: len(files)]
    array = Array(tx_m=profile.array.tx_m, rx_m=rx_m)
    first = codes[:, : frame.n_chirps * frame.chirp.n_samples]
    samples = first.reshape(len(files), frame.n_chirps, -1).transpose(1, 0, 2)
    recognised = recognise_ddma(samples.astype(np.float32), array, frame.chirp.wavelength_m)
    n_tx = 1 if recognised is None else len(recognised.multiplexing.order)
    if recognised is None or n_tx > len(array.tx_m):
        single = Array(tx_m=array.tx_m[:1], rx_m=rx_m)
        return Radar(frame=frame, array=single), (_single_transmitter_note(recognised),)
    coded = replace(
        frame,
        n_chirps=frame.n_chirps // recognised.multiplexing.n_sub_bands,
        multiplexing=recognised.multiplexing,
    )
    array = Array(tx_m=array.tx_m[:n_tx], rx_m=rx_m)
    return Radar(frame=coded, array=array), (_ddma_finding(recognised),)


def _ddma_finding(recognised: RecognisedDdma) -> Finding:
    code = recognised.multiplexing
    bands = ", ".join(map(str, code.sub_bands or ()))
    order = "in the order of the array" if recognised.is_order_known else "in unknown order"
    fit = f"plane waves explain {recognised.wave_fit:.0%} of the strongest echoes"
    velocity = (
        "" if recognised.is_static_band_known else "; without a static echo to tell their shift"
    )
    return Finding(
        level="note"
        if recognised.is_order_known and recognised.is_static_band_known
        else "warning",
        setting="radar.frame.multiplexing",
        value=f"Doppler division recognised: {len(code.order)} transmitters in sub-bands {bands} of"
        f" {code.n_sub_bands}, {order}; {fit}{velocity}",
        expected="transmitters whose order the array shows; else directions are left unknown",
        fix="give --radar with order and positions of the antennas, and record all receivers at"
        " the same time, if directions matter",
    )


def _single_transmitter_note(recognised: RecognisedDdma | None) -> Finding:
    description = (
        "no repetition in Doppler sub-bands"
        if recognised is None
        else "more sub-bands than antennas"
    )
    return Finding(
        level="note" if recognised is None else "warning",
        setting="radar.frame.multiplexing",
        value=f"{description}: one transmitter assumed",
        expected="the multiplexing of the recording",
        fix="give --radar if several transmitters were in use",
    )


def _remainder_note(n_samples: int) -> Finding:
    return Finding(
        level="note",
        setting="recording",
        value=f"{n_samples} samples after the last complete frame, not read",
        expected="complete frames",
        fix="no action needed for the frames before",
    )


def _too_short_error(path: Path, n_words: int, n_frame_words: int) -> RecordingError:
    return RecordingError(
        path,
        value=f"{n_words} numbers",
        expected=f"{n_frame_words} for a frame, by its settings",
        fix="copy the recording again from its source, or give its radar",
    )


def _damaged_error(file: Path, value: str) -> RecordingError:
    return RecordingError(
        file,
        value=value,
        expected="numbers of 32 bits, separated by commas",
        fix="copy the recording again from its source",
    )
