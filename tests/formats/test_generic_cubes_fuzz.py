"""Any bytes in a generic container are a cube of the radar's shape, or one clear refusal."""

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
    as_compressed_hdf5,
    as_compressed_matlab_5,
    as_compressed_npz,
    as_hdf5,
    as_matlab_5,
    as_matlab_7_3,
    as_npy,
    as_npz,
    as_zarr,
    as_zarr_2,
    integers,
    lines,
    radar,
    results,
)

from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings

RADAR = radar(n_chirps=2, n_rx=2, n_samples=4)
SHAPE = (2, 2, 2, 4)


def as_text(path, cube):
    numbers = np.stack([cube.real, cube.imag], axis=-1).reshape(-1, 16)
    (path / "cube.txt").write_text("one;two\n" + lines(numbers, ";", comma=True))
    return path / "cube.txt"


def as_bare(path, cube):
    np.stack([cube.real, cube.imag], axis=-1).astype("<i2").tofile(path / "cube.raw")
    return path / "cube.raw"


def as_results(path, _):
    return results(path)[0] / "cube.zarr"


MADE = {
    as_npy: "npy",
    as_npz: "npz",
    as_compressed_npz: "npz",
    as_matlab_5: "matlab",
    as_compressed_matlab_5: "matlab",
    as_matlab_7_3: "matlab",
    as_hdf5: "hdf5",
    as_compressed_hdf5: "hdf5",
    as_zarr: "zarr-array",
    as_zarr_2: "zarr-array",
    as_results: "zarr",
    as_text: "text-columns",
    as_bare: "bare-cube",
}


@cache
def good(made) -> dict[str, bytes]:
    """Files of a good recording, by their path below its own; the name alone for one file."""
    with TemporaryDirectory() as folder:
        path = made(Path(folder), integers(*SHAPE) / 32768)
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        return {
            str(file.relative_to(path.parent)): file.read_bytes()
            for file in files
            if file.is_file()
        }


def outcome(made, files: dict[str, bytes]) -> str:
    """Read what the files hold: "cube" or "refused", anything else fails."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        path = Path(folder) / Path(next(iter(files))).parts[0]
        kind = MADE[made]
        pairs = ("iq",) if kind in ("text-columns", "bare-cube") else ()
        told = RecordingHints(
            settings=RecordingSettings(radar=RADAR),
            axes=(*AXES, *pairs),
            encoding="int16" if pairs else "full-scale",
        )
        try:
            FORMATS[kind].recognise(path)
            contents = FORMATS[kind].read(path, RecordingHints() if kind == "zarr" else told)
            frame, n_rx = contents.radar.frame, contents.radar.array.n_rx
            assert kind == "zarr" or contents.radar == RADAR
            out = np.empty((frame.n_chirps_total, n_rx, frame.chirp.n_samples), np.complex64)
            for index in {0, contents.n_frames - 1}:
                contents.decode(index, out)
        except RecordingError as error:
            (only,) = error.mistakes
            assert only.value and only.expected and only.fix
            return "refused"
        return "cube"


ANY = pytest.mark.parametrize("made", MADE, ids=lambda made: made.__name__[3:])
FUZZED = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@ANY
def test_what_is_damaged_below_was_good(made):
    assert outcome(made, good(made)) == "cube"


@ANY
@FUZZED
@given(st.data())
def test_flipped_bits_give_a_cube_or_a_refusal(made, data):
    files = dict(good(made))
    name = data.draw(st.sampled_from(sorted(files)))
    content = bytearray(files[name])
    for _ in range(data.draw(st.integers(1, 4))):
        # Most of what can go wrong is said at the beginning.
        end = data.draw(st.sampled_from([min(256, len(content)), len(content)]))
        content[data.draw(st.integers(0, end - 1))] ^= 1 << data.draw(st.integers(0, 7))
    files[name] = bytes(content)

    outcome(made, files)


@ANY
@FUZZED
@given(st.data())
def test_files_cut_short_give_a_cube_or_a_refusal(made, data):
    files = dict(good(made))
    name = data.draw(st.sampled_from(sorted(files)))
    files[name] = files[name][: data.draw(st.integers(0, len(files[name]) - 1))]

    outcome(made, files)


@ANY
@FUZZED
@given(st.data())
def test_any_bytes_after_the_mark_of_a_format_give_a_cube_or_a_refusal(made, data):
    files = dict(good(made))
    name = data.draw(st.sampled_from(sorted(files)))
    kept = data.draw(st.sampled_from([0, 8, 20, 128, 512]))
    files[name] = files[name][:kept] + data.draw(st.binary(max_size=600))

    outcome(made, files)
