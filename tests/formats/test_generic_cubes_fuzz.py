"""Corrupted generic containers: a cube of the radar's shape or one clear error."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_generic_cubes import (
    AXES,
    FORMATS,
    draw_samples,
    format_lines,
    make_radar,
    write_compressed_hdf5,
    write_compressed_matlab_5,
    write_compressed_npz,
    write_hdf5,
    write_matlab_5,
    write_matlab_7_3,
    write_npy,
    write_npz,
    write_run_folder,
    write_zarr,
    write_zarr_2,
)

from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from nightly import n_examples

RADAR = make_radar(n_chirps=2, n_rx=2, n_samples=4)
SHAPE = (2, 2, 2, 4)


def write_text(path, cube):
    numbers = np.stack([cube.real, cube.imag], axis=-1).reshape(-1, 16)
    (path / "cube.txt").write_text("one;two\n" + format_lines(numbers, ";", comma=True))
    return path / "cube.txt"


def write_bare(path, cube):
    np.stack([cube.real, cube.imag], axis=-1).astype("<i2").tofile(path / "cube.raw")
    return path / "cube.raw"


def write_run(path, _):
    return write_run_folder(path)[0] / "cube.zarr"


FORMAT_BY_WRITER = {
    write_npy: "npy",
    write_npz: "npz",
    write_compressed_npz: "npz",
    write_matlab_5: "matlab",
    write_compressed_matlab_5: "matlab",
    write_matlab_7_3: "matlab",
    write_hdf5: "hdf5",
    write_compressed_hdf5: "hdf5",
    write_zarr: "zarr-array",
    write_zarr_2: "zarr-array",
    write_run: "zarr",
    write_text: "text-columns",
    write_bare: "bare-cube",
}


@cache
def read_valid_files(writer) -> dict[str, bytes]:
    """Return the files of a valid recording by relative path."""
    with TemporaryDirectory() as folder:
        path = writer(Path(folder), draw_samples(*SHAPE) / 32768)
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        return {
            str(file.relative_to(path.parent)): file.read_bytes()
            for file in files
            if file.is_file()
        }


def classify_files(writer, files: dict[str, bytes]) -> str:
    """Read files and return "cube" or "refused"; any other outcome fails."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        path = Path(folder) / Path(next(iter(files))).parts[0]
        kind = FORMAT_BY_WRITER[writer]
        pairs = ("iq",) if kind in ("text-columns", "bare-cube") else ()
        hints = RecordingHints(
            settings=RecordingSettings(radar=RADAR),
            axes=(*AXES, *pairs),
            encoding="int16" if pairs else "full-scale",
        )
        try:
            FORMATS[kind].recognise(path)
            contents = FORMATS[kind].read(path, RecordingHints() if kind == "zarr" else hints)
            frame, n_rx = contents.radar.frame, contents.radar.array.n_rx
            assert kind == "zarr" or contents.radar == RADAR
            out = np.empty((frame.n_chirps_total, n_rx, frame.chirp.n_samples), np.complex64)
            for index in {0, contents.n_frames - 1}:
                contents.decode(index, out)
        except RecordingError as error:
            (mistake,) = error.mistakes
            assert mistake.value and mistake.expected and mistake.fix
            return "refused"
        return "cube"


EVERY_WRITER = pytest.mark.parametrize(
    "writer", FORMAT_BY_WRITER, ids=lambda writer: writer.__name__.removeprefix("write_")
)
FUZZ_SETTINGS = settings(
    max_examples=n_examples(60), deadline=None, suppress_health_check=[HealthCheck.too_slow]
)


@EVERY_WRITER
def test_valid_files_give_cube(writer):
    assert classify_files(writer, read_valid_files(writer)) == "cube"


@EVERY_WRITER
@FUZZ_SETTINGS
@given(st.data())
def test_flipped_bits_give_cube_or_error(writer, data):
    files = dict(read_valid_files(writer))
    name = data.draw(st.sampled_from(sorted(files)))
    content = bytearray(files[name])
    for _ in range(data.draw(st.integers(1, 4))):
        # Headers hold most of the fields that a reader must check.
        end = data.draw(st.sampled_from([min(256, len(content)), len(content)]))
        content[data.draw(st.integers(0, end - 1))] ^= 1 << data.draw(st.integers(0, 7))
    files[name] = bytes(content)

    classify_files(writer, files)


@EVERY_WRITER
@FUZZ_SETTINGS
@given(st.data())
def test_truncated_files_give_cube_or_error(writer, data):
    files = dict(read_valid_files(writer))
    name = data.draw(st.sampled_from(sorted(files)))
    files[name] = files[name][: data.draw(st.integers(0, len(files[name]) - 1))]

    classify_files(writer, files)


@EVERY_WRITER
@FUZZ_SETTINGS
@given(st.data())
def test_random_bytes_after_signature_give_cube_or_error(writer, data):
    files = dict(read_valid_files(writer))
    name = data.draw(st.sampled_from(sorted(files)))
    n_header_bytes = data.draw(st.sampled_from([0, 8, 20, 128, 512]))
    files[name] = files[name][:n_header_bytes] + data.draw(st.binary(max_size=600))

    classify_files(writer, files)
