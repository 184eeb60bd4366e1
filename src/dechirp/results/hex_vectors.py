"""Test vectors for RTL test benches: every integer of the fixed-point chain, as hex words.

A folder contains the lookup tables, the samples of one frame and the output of each block, one
word a line, in two's complement with as many digits as its bits need, as $readmemh reads it; and
`vectors.json`, which describes the files.
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

from dechirp.core.argument_types import check_argument_types
from dechirp.core.atomic_files import atomic_folder, check_output_folder_replaceable
from dechirp.core.checks import check_integer
from dechirp.core.errors import RecordingError, quote_for_message
from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.chain import StageOutput, stage_outputs
from dechirp.processing.fixed_point.lookup_tables import LookupTables, make_lookup_tables
from dechirp.processing.fixed_point.samples import to_integer_samples_and_step
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.radar.radar import Radar

FORMAT_VERSION = 1
DESCRIPTION = "vectors.json"
_MAX_BITS = 63  # of a word in int64

_BLOCK_DESCRIPTIONS = {
    "range_weights": "table: window over samples, bits - 2 of each behind the point",
    "range_twiddles": "table: exp(-2 pi i k / n), k < n / 2, bits - 2 behind the point",
    "doppler_weights": "table: window over chirps, every other weight with its sign turned",
    "doppler_twiddles": "table: as range_twiddles",
    "logarithms": "table: log2(1 + f) in the middle of each interval of f, a whole number",
    "factors": "table: threshold over sum of the training cells, for each searched row, x 2^factor",
    "samples": "input",
    "range_window": "samples x range_weights, shifted right by `range`, zeros behind",
    "range_fft": "transform of range_window along each chirp of each channel",
    "range_shifts": "bits that range_fft shifted right at each stage",
    "doppler_window": "range_fft x doppler_weights, shifted right by `doppler` and by what the"
    " range_shifts of its chirp add up to less than those of the chirp with most",
    "doppler_fft": "transform of doppler_window; bin 0 is the most negative velocity",
    "doppler_shifts": "bits that doppler_fft shifted right at each stage",
    "power": "sum over channels of I^2 + Q^2, each shifted left by `power` and right by twice what"
    " its doppler_shifts add up to less than those of the row with most",
    "log_power": "log2 of power: place of its leading one, then the entry of `logarithms` that the"
    " bits behind it address",
    "threshold": "sum of power over the training cells x factors, shifted right by `factor`,"
    " truncated;"
    " the largest word where it would be larger, and in rows not searched",
    "detected": "1 where power exceeds threshold",
}
_COMPLEX_BLOCKS = (
    *("range_twiddles", "doppler_twiddles", "samples"),
    *("range_window", "range_fft", "doppler_window", "doppler_fft"),
)
FILES = (
    DESCRIPTION,
    *(f"{name}.hex" for name in _BLOCK_DESCRIPTIONS),
    *(f"{name}_{part}.hex" for name in _COMPLEX_BLOCKS for part in "iq"),
)
"""All file names that a folder of vectors may contain."""

_WORDS_PER_CHUNK = 2**16  # words that are written or read at a time


def check_vector_folder_replaceable(out: Path) -> None:
    """Raise `DechirpError` if a folder cannot take vectors since it holds other files."""
    check_output_folder_replaceable(out, marker_file=DESCRIPTION, own_names=FILES)


@check_argument_types
def write_vectors(
    out: str | Path,
    cube: xr.DataArray,
    radar: Radar,
    chain: Chain | None = None,
    words: WordLengths | None = None,
) -> dict[str, Path]:
    """Write the vectors of one frame into a folder, atomically, and replace earlier ones.

    Parameters
    ----------
    out : str or Path
        The folder.
    cube, radar, chain, words
        As for `fixed_point_map`.

    Returns
    -------
    dict
        Path of each file by its name.

    Raises
    ------
    InvalidSetting
        As for `fixed_point_map`.
    DechirpError
        If the folder holds other files or cannot be written. It is then unchanged.
    """
    out = Path(out)
    check_vector_folder_replaceable(out)
    plan = make_lookup_tables(radar, (chain or Chain()).fit_to_radar(radar), words or WordLengths())
    samples, step = to_integer_samples_and_step(cube, radar, plan.words)
    with atomic_folder(out) as temporary:
        entries = [
            _write_stage_output(temporary, block)
            for source in (_lookup_table_outputs(plan), stage_outputs(samples, radar, plan))
            for block in source
        ]
        content = _vector_set_description(plan, step) | {"vectors": entries}
        text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
        (temporary / DESCRIPTION).write_text(text, encoding="utf-8")
    written = [file for entry in entries for file in entry["files"]]
    return {name: out / name for name in (DESCRIPTION, *written)}


@check_argument_types
def read_vectors(folder: str | Path) -> dict[str, np.ndarray]:
    """Read the integers of every vector in a folder by its name, int64, in the described shape.

    Parameters
    ----------
    folder : path
        Folder of the vectors with their description.

    Raises
    ------
    RecordingError
        If a file is missing or was changed.
    """
    folder = Path(folder)
    description = folder / DESCRIPTION
    try:
        description_json = json.loads(description.read_text(encoding="utf-8"))
        version, entries = description_json["format_version"], description_json["vectors"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise _invalid_description_error(description, error) from None
    if version != FORMAT_VERSION:
        raise RecordingError(
            description,
            value=f"version {version}",
            expected=f"version {FORMAT_VERSION}",
            fix="write the vectors again",
        )
    try:
        return {entry["name"]: _read_vector(folder, entry) for entry in entries}
    except (ValueError, LookupError, TypeError, OverflowError, AttributeError) as error:
        raise _invalid_description_error(description, error) from None


def read_words(path: str | Path, *, bits: int, signed: bool) -> np.ndarray:
    """Read the integers in a file of hex words, one a line, (n,) int64, also those of $writememh.

    Empty lines and lines that begin with `//` are skipped.

    Raises
    ------
    InvalidSetting
        If `bits` is out of range.
    RecordingError
        If the file cannot be read, or a line is not a word of `bits` bits.
    """
    check_integer("bits", bits, at_least=1, at_most=_MAX_BITS)
    try:
        if not Path(path).is_file():  # reading a device may never end
            raise FileNotFoundError(ENOENT, "No such file")
        lines = Path(path).read_text(encoding="ascii").split("\n")
        words = np.array([int(line, 16) for line in lines if line and line[:2] != "//"], np.int64)
    except (OSError, ValueError, OverflowError) as error:
        raise RecordingError(
            path,
            value=f"not readable ({error})",
            expected="hex words without x or z, one a line",
            fix="write these words in the simulation; x and z mark words never written",
        ) from None
    if words.size and not (words.min() >= 0 and words.max() < 1 << bits):
        raise RecordingError(
            path,
            value=f"a word of {int(words.max()).bit_length()} bits",
            expected=f"words of {bits} bits",
            fix="set bits to the width of its words",
        )
    return words - ((words >> (bits - 1)) << bits) if signed else words


def _lookup_table_outputs(plan: LookupTables) -> Iterator[StageOutput]:
    """Yield the lookup tables of the machine."""
    words = plan.words
    yield StageOutput("range_weights", plan.range_window, ("sample",), words.window_bits)
    yield StageOutput("range_twiddles", plan.range_twiddles, ("turn", "iq"), words.twiddle_bits)
    yield StageOutput("doppler_weights", plan.doppler_window, ("chirp",), words.window_bits)
    yield StageOutput("doppler_twiddles", plan.doppler_twiddles, ("turn", "iq"), words.twiddle_bits)
    log_bits = words.log_fraction_bits + 1
    yield StageOutput("logarithms", plan.logarithms, ("address",), log_bits, is_signed=False)
    yield StageOutput("factors", plan.factors, ("range",), words.factor_bits, is_signed=False)


def _vector_set_description(plan: LookupTables, sample_step: float) -> dict[str, Any]:
    training, guard = plan.training_window.n_training, plan.training_window.n_guard
    bits = plan.words.sample_bits
    name = "samples_i" if plan.n_rows == plan.range_transform.n_bins else "samples"
    n = plan.doppler_transform.n_points * plan.n_channels * plan.range_transform.n_points
    return {
        "format_version": FORMAT_VERSION,
        "words": asdict(plan.words),
        "sizes": {
            "chirp": plan.doppler_transform.n_points,
            "channel": plan.n_channels,
            "sample": plan.range_transform.n_points,
            "range_fft": plan.range_transform.n_bins,
            "range": plan.n_rows,
            "doppler_fft": plan.doppler_transform.n_bins,
        },
        "shifts": {
            "range": plan.range_product_right_shift,
            "doppler": plan.doppler_product_right_shift,
            "power": plan.power_left_shift,
            "factor": plan.factor_shift,
        },
        "cfar": {
            "n_training": asdict(training),
            "n_guard": asdict(guard),
            "first_row": plan.searched_rows.start,
            "ends": "velocity wraps round; the box stays within the rows searched",
        },
        "step": sample_step,
        "files": "one word a line, the last axis fastest; two's complement where signed;"
        " _i is the real part, _q the imaginary part",
        "verilog": f"reg signed [{bits - 1}:0] {name} [0:{n - 1}];"
        f' initial $readmemh("{name}.hex", {name});',
    }


def _write_stage_output(folder: Path, output: StageOutput) -> dict[str, Any]:
    """Write the words of a block and return its entry of the description."""
    parts = {output.name: output.integers}
    axes = output.axes
    if axes[-1] == "iq":
        parts = {f"{output.name}_{part}": output.integers[..., k] for k, part in enumerate("iq")}
        axes = axes[:-1]
    checksums = [
        _write_hex_words(folder / f"{name}.hex", integers, output.bits)
        for name, integers in parts.items()
    ]
    return {
        "name": output.name,
        "what": _BLOCK_DESCRIPTIONS[output.name],
        "files": [f"{name}.hex" for name in parts],
        "bits": output.bits,
        "signed": output.is_signed,
        "axes": list(axes),
        "shape": list(next(iter(parts.values())).shape),
        "sha256": checksums,
        "overflows": output.overflows.tolist(),
    }


def _write_hex_words(path: Path, integers: np.ndarray, bits: int) -> str:
    """Write words and return the SHA-256 of the file."""
    digits = np.arange(-(-bits // 4) - 1, -1, -1) * 4
    letters = np.frombuffer(b"0123456789abcdef", np.uint8)
    checksum = hashlib.sha256()
    flat = integers.reshape(-1)
    with path.open("wb") as file:
        for first in range(0, flat.size, _WORDS_PER_CHUNK):
            words = flat[first : first + _WORDS_PER_CHUNK].astype(np.int64) & ((1 << bits) - 1)
            lines = np.full((words.size, digits.size + 1), ord("\n"), np.uint8)
            lines[:, :-1] = letters[words[:, None] >> digits & 15]
            checksum.update(lines.tobytes())
            file.write(lines.tobytes())
    return checksum.hexdigest()


def _invalid_description_error(path: Path, error: Exception) -> RecordingError:
    return RecordingError(
        path,
        value=f"not a description of vectors ({type(error).__name__})",
        expected="the file that write_vectors wrote",
        fix="name a folder of vectors",
    )


def _read_vector(folder: Path, entry: dict[str, Any]) -> np.ndarray:
    parts = []
    for name, checksum in zip(entry["files"], entry["sha256"], strict=True):
        path = folder / name
        is_plain = path.parent == folder and name == quote_for_message(name)
        if not is_plain:  # reject paths that leave the folder
            raise RecordingError(
                folder / DESCRIPTION,
                value=f"naming {quote_for_message(name)} for a file",
                expected="plain names of files in the same folder",
                fix="write the vectors again",
            )
        parts.append(read_words(path, bits=entry["bits"], signed=entry["signed"]))
        if hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
            raise RecordingError(
                path,
                value="changed since it was written",
                expected="a file with the SHA-256 of the description",
                fix="write the vectors again, or read the file with read_words",
            )
    shaped = [words.reshape(entry["shape"]) for words in parts]
    return np.stack(shaped, axis=-1) if len(shaped) > 1 else shaped[0]
