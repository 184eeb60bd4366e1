"""Test vectors for a bench in an RTL simulator: every word of the chain in whole numbers, as hex.

A folder holds the tables of the machine, the samples of one frame and what each block makes of
them, one word a line, in two's complement and as many digits as its bits need, as $readmemh
reads it; and `vectors.json`, which says what is where.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from errno import ENOENT
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.config.shown import shown
from dechirp.core.checks import whole
from dechirp.core.errors import RecordingError
from dechirp.process.chain import Chain
from dechirp.process.fixed_point.chain import Block, blocks
from dechirp.process.fixed_point.samples import whole_samples
from dechirp.process.fixed_point.tables import Tables, tables
from dechirp.process.fixed_point.words import WordLengths
from dechirp.radar.radar import Radar
from dechirp.store.whole import must_be_replaceable, whole_folder

FORMAT_VERSION = 1
DESCRIPTION = "vectors.json"
_MOST_BITS = 63  # of a word in int64

_MADE = {
    "range_weights": "table: window over samples, bits - 2 of each behind the point",
    "range_twiddles": "table: exp(-2 pi i k / n), k < n / 2, bits - 2 behind the point",
    "doppler_weights": "table: window over chirps, every other weight with its sign turned",
    "doppler_twiddles": "table: as range_twiddles",
    "logarithms": "table: log2(1 + f) in the middle of each interval of f, a whole number",
    "factors": "table: threshold over sum of the ring, for each row searched, x 2^factor",
    "samples": "input",
    "range_window": "samples x range_weights, shifted right by `range`, zeros behind",
    "range_fft": "transform of range_window, each chirp of each channel by itself",
    "range_shifts": "bits that range_fft shifted right at each stage",
    "doppler_window": "range_fft x doppler_weights, shifted right by `doppler` and by what the"
    " range_shifts of its chirp add up to less than those of the chirp with most",
    "doppler_fft": "transform of doppler_window; bin 0 is the most negative velocity",
    "doppler_shifts": "bits that doppler_fft shifted right at each stage",
    "power": "sum over channels of I^2 + Q^2, each shifted left by `power` and right by twice what"
    " its doppler_shifts add up to less than those of the row with most",
    "log_power": "log2 of power: place of its leading one, then the entry of `logarithms` that the"
    " bits behind it address",
    "threshold": "sum of power over the ring x factors, shifted right by `factor`, truncated; the"
    " largest word where it would be larger, and in rows not searched",
    "detected": "1 where power exceeds threshold",
}
_COMPLEX = (
    *("range_twiddles", "doppler_twiddles", "samples"),
    *("range_window", "range_fft", "doppler_window", "doppler_fft"),
)
FILES = (
    DESCRIPTION,
    *(f"{name}.hex" for name in _MADE),
    *(f"{name}_{part}.hex" for name in _COMPLEX for part in "iq"),
)
"""Every file that a folder of vectors may hold."""

_HELD = 2**16  # words that are written or read at a time


def check_out(out: Path) -> None:
    """Raise `DechirpError` if a folder cannot take vectors: it holds something else."""
    must_be_replaceable(out, mark=DESCRIPTION, ours=FILES)


def write_vectors(
    out: str | Path,
    cube: xr.DataArray,
    radar: Radar,
    chain: Chain | None = None,
    words: WordLengths | None = None,
) -> dict[str, Path]:
    """Write the vectors of one frame into a folder, in place of earlier ones; all or none.

    Parameters
    ----------
    out : str or Path
        The folder.
    cube, radar, chain, words
        As of `fixed_point_map`.

    Returns
    -------
    dict
        Path of each file by its name.

    Raises
    ------
    InvalidSetting
        As of `fixed_point_map`.
    DechirpError
        If the folder is somebody else's or cannot be written. It is left as it was then.
    """
    out = Path(out)
    check_out(out)
    plan = tables(radar, (chain or Chain()).fitted(radar), words or WordLengths())
    samples, step = whole_samples(cube, radar, plan.words)
    with whole_folder(out) as made:
        entries = [
            _write(made, block)
            for source in (_tables(plan), blocks(samples, radar, plan))
            for block in source
        ]
        content = _about(plan, step) | {"vectors": entries}
        text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
        (made / DESCRIPTION).write_text(text, encoding="utf-8")
    written = [file for entry in entries for file in entry["files"]]
    return {name: out / name for name in (DESCRIPTION, *written)}


def read_vectors(folder: str | Path) -> dict[str, np.ndarray]:
    """Integers of every vector in a folder by its name, int64, in the shape described.

    Raises
    ------
    RecordingError
        If a file is missing, or is not what was written.
    """
    folder = Path(folder)
    description = folder / DESCRIPTION
    try:
        about = json.loads(description.read_text(encoding="utf-8"))
        version, entries = about["format_version"], about["vectors"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise _no_description(description, error) from None
    if version != FORMAT_VERSION:
        raise RecordingError(
            description,
            got=f"of version {version}",
            need=f"of version {FORMAT_VERSION}",
            fix="Write the vectors again.",
        )
    try:
        return {entry["name"]: _read(folder, entry) for entry in entries}
    except (ValueError, LookupError, TypeError, OverflowError, AttributeError) as error:
        raise _no_description(description, error) from None


def read_words(path: str | Path, *, bits: int, signed: bool) -> np.ndarray:
    """Integers in a file of hex words, one a line, (n,) int64: of ours, or of $writememh.

    Raises
    ------
    InvalidSetting
        If the bits are none.
    RecordingError
        If it cannot be read, or a line is no word of so many bits; lines that begin with `//` or
        are empty say nothing.
    """
    whole("bits", bits, at_least=1, at_most=_MOST_BITS)
    try:
        if not Path(path).is_file():  # a device would never end
            raise FileNotFoundError(ENOENT, "No such file")
        lines = Path(path).read_text(encoding="ascii").split("\n")
        words = np.array([int(line, 16) for line in lines if line and line[:2] != "//"], np.int64)
    except (OSError, ValueError, OverflowError) as error:
        raise RecordingError(
            path,
            got=f"not readable ({error})",
            need="hex words, one a line, all of them known",
            fix="An x or z is a word that the machine never wrote.",
        ) from None
    if words.size and not (words.min() >= 0 and words.max() < 1 << bits):
        raise RecordingError(
            path,
            got=f"a word of {int(words.max()).bit_length()} bits",
            need=f"words of {bits} bits",
            fix="Give the bits of the words in it.",
        )
    return words - ((words >> (bits - 1)) << bits) if signed else words


def _tables(plan: Tables) -> Iterator[Block]:
    """What the machine holds before the first sample."""
    words = plan.words
    yield Block("range_weights", plan.range_window, ("sample",), words.window_bits)
    yield Block("range_twiddles", plan.range_twiddles, ("turn", "iq"), words.twiddle_bits)
    yield Block("doppler_weights", plan.doppler_window, ("chirp",), words.window_bits)
    yield Block("doppler_twiddles", plan.doppler_twiddles, ("turn", "iq"), words.twiddle_bits)
    log_bits = words.log_fraction_bits + 1
    yield Block("logarithms", plan.logarithms, ("address",), log_bits, is_signed=False)
    yield Block("factors", plan.factors, ("range",), words.factor_bits, is_signed=False)


def _about(plan: Tables, step: float) -> dict[str, Any]:
    training, guard = plan.ring.n_training, plan.ring.n_guard
    bits = plan.words.sample_bits
    name = "samples_i" if plan.n_rows == plan.over_range.n_bins else "samples"
    n = plan.over_velocity.n_points * plan.n_channels * plan.over_range.n_points
    return {
        "format_version": FORMAT_VERSION,
        "words": asdict(plan.words),
        "sizes": {
            "chirp": plan.over_velocity.n_points,
            "channel": plan.n_channels,
            "sample": plan.over_range.n_points,
            "range_fft": plan.over_range.n_bins,
            "range": plan.n_rows,
            "doppler_fft": plan.over_velocity.n_bins,
        },
        "shifts": {
            "range": plan.range_shift,
            "doppler": plan.doppler_shift,
            "power": plan.power_shift,
            "factor": plan.factor_shift,
        },
        "cfar": {
            "n_training": asdict(training),
            "n_guard": asdict(guard),
            "first_row": plan.searched.start,
            "ends": "velocity wraps round; the box stays within the rows searched",
        },
        "step": step,
        "files": "one word a line, the last axis fastest; two's complement where signed;"
        " _i is the real part, _q the imaginary part",
        "verilog": f"reg signed [{bits - 1}:0] {name} [0:{n - 1}];"
        f' initial $readmemh("{name}.hex", {name});',
    }


def _write(folder: Path, block: Block) -> dict[str, Any]:
    """Write the words of a block, and return what the description says of it."""
    parts = {block.name: block.integers}
    axes = block.axes
    if axes[-1] == "iq":
        parts = {f"{block.name}_{part}": block.integers[..., k] for k, part in enumerate("iq")}
        axes = axes[:-1]
    checksums = [_write_words(folder / f"{name}.hex", of, block.bits) for name, of in parts.items()]
    return {
        "name": block.name,
        "what": _MADE[block.name],
        "files": [f"{name}.hex" for name in parts],
        "bits": block.bits,
        "signed": block.is_signed,
        "axes": list(axes),
        "shape": list(next(iter(parts.values())).shape),
        "sha256": checksums,
        "overflows": block.overflows.tolist(),
    }


def _write_words(path: Path, integers: np.ndarray, bits: int) -> str:
    """Write words, and return the SHA-256 of the file."""
    digits = np.arange(-(-bits // 4) - 1, -1, -1) * 4
    letters = np.frombuffer(b"0123456789abcdef", np.uint8)
    checksum = hashlib.sha256()
    flat = integers.reshape(-1)
    with path.open("wb") as file:
        for first in range(0, flat.size, _HELD):
            words = flat[first : first + _HELD].astype(np.int64) & ((1 << bits) - 1)
            lines = np.full((words.size, digits.size + 1), ord("\n"), np.uint8)
            lines[:, :-1] = letters[words[:, None] >> digits & 15]
            checksum.update(lines.tobytes())
            file.write(lines.tobytes())
    return checksum.hexdigest()


def _no_description(path: Path, error: Exception) -> RecordingError:
    return RecordingError(
        path,
        got=f"no description of vectors ({type(error).__name__})",
        need="the file that write_vectors wrote",
        fix="Name a folder of vectors.",
    )


def _read(folder: Path, entry: dict[str, Any]) -> np.ndarray:
    parts = []
    for name, checksum in zip(entry["files"], entry["sha256"], strict=True):
        path = folder / name
        is_plain = path.parent == folder and name == shown(name)
        if not is_plain:  # a description from elsewhere reads nothing beside its folder
            raise RecordingError(
                folder / DESCRIPTION,
                got=f"naming {shown(name)} for a file",
                need="plain names of files beside it",
                fix="Write the vectors again.",
            )
        parts.append(read_words(path, bits=entry["bits"], signed=entry["signed"]))
        if hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
            raise RecordingError(
                path,
                got="changed since it was written",
                need="as the description says, by its SHA-256",
                fix="Write the vectors again; read_words reads other files.",
            )
    shaped = [words.reshape(entry["shape"]) for words in parts]
    return np.stack(shaped, axis=-1) if len(shaped) > 1 else shaped[0]
