"""Cubes in containers that say nothing of radar: the user names the axes.

Files are made by the libraries of their formats, or byte by byte, never with the package.
"""

import gzip
import json
import math
import os
import pickle
import struct
import subprocess
import sys
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numcodecs
import numpy as np
import pytest
import scipy.io
import zarr
import zarr.codecs

import dechirp
from dechirp.cli.commands.list import list_members
from dechirp.core.errors import RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import RecordingSettings

FORMATS = {kind: member() for kind, member in Format.members().items()}
AXES = ("frame", "chirp", "rx", "sample")


def radar(*, n_chirps=4, n_rx=2, n_samples=8, sampling="complex", order=None) -> Radar:
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=20e-6,
        sample_rate_hz=5e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    tdm = None if order is None else Tdm(order=order)
    array = Array(
        tx_m=tuple((0.0, 8e-3 * n, 0.0) for n in range(len(order or (0,)))),
        rx_m=tuple((0.0, 2e-3 * n, 0.0) for n in range(n_rx)),
    )
    frame = Frame(chirp=chirp, n_chirps=n_chirps, interval_s=30e-6, multiplexing=tdm)
    return Radar(frame=frame, array=array)


def read(path, kind, of=None, *, inside=None, **told) -> Contents:
    """Open by content alone, where the content says what it is."""
    opened = open_recording(
        path if inside is None else path / inside,
        radar=of or radar(),
        format=kind if FORMATS[kind].must_be_named else None,
        **told,
    )
    assert opened.format == kind
    return opened.contents


def decoded(contents: Contents) -> np.ndarray:
    """All frames, (frame, chirp, rx, sample)."""
    frame, n_rx = contents.radar.frame, contents.radar.array.n_rx
    kind = np.complex64 if frame.chirp.sampling == "complex" else np.float32
    shape = (contents.n_frames, frame.n_chirps_total, n_rx, frame.chirp.n_samples)
    cube = np.full(shape, np.nan, kind)
    for index in range(contents.n_frames):
        contents.decode(index, cube[index])
    return cube


def mistake(path, kind, of=None, **told):
    """Give the one mistake that a recording is refused for, at once or when it is decoded."""
    with pytest.raises(RecordingError) as error:
        decoded(read(path, kind, of, **told))
    (only,) = error.value.mistakes
    return only


def integers(*shape, seed=1):
    re, im = np.random.default_rng(seed).integers(-32768, 32768, size=(2, *shape))
    return re + 1j * im


def pairs(samples, names=("real", "imag"), dtype=np.float32):
    made = np.empty(samples.shape, [(name, dtype) for name in names])
    made[names[0]], made[names[1]] = samples.real, samples.imag
    return made


# --- The same cube in every container -------------------------------------------------


def as_npy(path, cube):
    np.save(path / "cube.npy", cube)
    return path / "cube.npy"


def as_npz(path, cube, *, save=np.savez):
    save(path / "cube.npz", samples=cube, times=np.arange(3.0))
    return path / "cube.npz"


def as_compressed_npz(path, cube):
    return as_npz(path, cube, save=np.savez_compressed)


def as_matlab_5(path, cube, *, compressed=False):
    file = path / "cube.mat"
    scipy.io.savemat(
        file, {"info": {"fs": 5e6}, "samples": cube, "name": "x"}, do_compression=compressed
    )
    return file


def as_compressed_matlab_5(path, cube):
    return as_matlab_5(path, cube, compressed=True)


def as_matlab_7_3(path, cube):
    file = path / "cube.mat"
    with h5py.File(file, "w", userblock_size=512) as made:
        said = made.create_dataset("samples", data=pairs(cube.T, dtype=np.float64), chunks=True)
        said.attrs["MATLAB_class"] = np.bytes_("double")
        name = made.create_dataset("name", data=np.full((8, 4), 65, np.uint16))
        name.attrs["MATLAB_class"] = np.bytes_("char")
    content = file.read_bytes()
    file.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b" ") + content[512:])
    return file


def as_hdf5(path, cube, **how):
    with h5py.File(path / "cube.h5", "w") as made:
        made.create_dataset("scene/radar/samples", data=cube, **how)
        made["times"] = np.arange(3.0)
        made["link"] = h5py.SoftLink("/scene/radar/samples")
    return path / "cube.h5"


def as_compressed_hdf5(path, cube):
    return as_hdf5(path, cube, compression="gzip", chunks=True)


def as_zarr(path, cube, *, zarr_format=3):
    group = zarr.create_group(path / "cube.zarr", zarr_format=zarr_format)
    chunks = tuple(-(-size // 2) for size in cube.shape)
    group.create_array("samples", shape=cube.shape, chunks=chunks, dtype=cube.dtype)[:] = cube
    group.create_array("times", data=np.arange(3.0))
    return path / "cube.zarr"


def as_zarr_2(path, cube):
    return as_zarr(path, cube, zarr_format=2)


CONTAINERS = {
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
}


@pytest.fixture(params=CONTAINERS, ids=lambda made: made.__name__[3:])
def container(request):
    return request.param


@pytest.mark.parametrize(
    "axes",
    [AXES, ("sample", "rx", "chirp", "frame"), ("rx", "frame", "sample", "chirp")],
    ids=",".join,
)
def test_every_container_gives_the_cube_that_was_put_in(tmp_path, container, axes):
    sent = integers(3, 4, 2, 8)
    file = container(tmp_path, np.transpose(sent, [AXES.index(name) for name in axes]))

    contents = read(file, CONTAINERS[container], axes=axes, encoding="int16")

    cube = decoded(contents)
    # Numbers of 16 bits over 32768 are exact in float32.
    assert np.array_equal(cube * 32768, sent)
    again = np.empty_like(cube[0])
    contents.decode(0, again)  # back to the first after the last
    assert np.array_equal(again, cube[0])
    assert contents.gaps is None


def sent_together() -> Radar:
    """Two transmitters that send in every chirp."""
    in_turns = radar(order=(0, 1))
    return replace(in_turns, frame=replace(in_turns.frame, multiplexing=Bpm(order=(0, 1))))


def test_chirps_that_transmitters_send_together_are_read_as_they_were_taken(tmp_path):
    np.save(tmp_path / "cube.npy", integers(8, 2, 8))

    told = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    cube = decoded(read(tmp_path / "cube.npy", "npy", sent_together(), **told))

    assert np.array_equal(cube[0] * 32768, integers(8, 2, 8))


@pytest.mark.parametrize("axes", [("chirp", "tx", "rx", "sample"), ("chirp", "element", "sample")])
def test_no_single_transmitter_is_looked_for_where_several_send_in_a_chirp(tmp_path, axes):
    sizes = {"chirp": 4, "tx": 2, "rx": 2, "element": 4, "sample": 8}
    np.save(tmp_path / "cube.npy", integers(*(sizes[name] for name in axes)))

    with pytest.raises(RecordingError, match="several transmitters send in each chirp"):
        read(tmp_path / "cube.npy", "npy", sent_together(), axes=axes, encoding="int16")


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize("names", ["chirp,tx,rx,sample", "rx,sample,tx,chirp", "element"])
def test_transmitters_that_take_turns_are_put_in_the_order_they_sent(
    tmp_path, container, order, names
):
    by_tx = integers(4, 3, 2, 8)  # chirp, tx, rx, sample
    if names == "element":
        names = "chirp,element,sample"
        array = by_tx.reshape(4, 6, 8)
    else:
        own = ["chirp", "tx", "rx", "sample"]
        array = np.transpose(by_tx, [own.index(name) for name in names.split(",")])

    file = container(tmp_path, array)
    told = {"axes": tuple(names.split(",")), "encoding": "int16"}
    cube = decoded(read(file, CONTAINERS[container], radar(order=order), **told))

    for slot, transmitter in enumerate(order):
        assert np.array_equal(cube[0, slot::3] * 32768, by_tx[:, transmitter])


def test_chirps_without_a_transmitter_axis_are_in_the_order_sent(tmp_path):
    sent = integers(12, 2, 8)
    file = as_npy(tmp_path, sent)

    of = radar(order=(2, 0, 1))
    cube = decoded(read(file, "npy", of, axes=("chirp", "rx", "sample"), encoding="int16"))

    assert np.array_equal(cube[0] * 32768, sent)


def test_a_snapshot_needs_neither_a_frame_nor_a_chirp_axis(tmp_path):
    sent = integers(6, 8)
    file = as_matlab_5(tmp_path, sent)

    of = radar(n_chirps=1, order=(0, 1, 2))
    cube = decoded(read(file, "matlab", of, axes=("element", "sample"), encoding="int16"))

    assert np.array_equal(cube[0] * 32768, sent.reshape(3, 2, 8))


@pytest.mark.parametrize("names", [("real", "imag"), ("re", "im"), ("r", "i"), ("Imag", "Real")])
def test_pairs_of_fields_are_complex_numbers(tmp_path, names):
    sent = integers(4, 2, 8)
    of_integers = pairs(sent if names[0] != "Imag" else sent.imag + 1j * sent.real, names, "<i2")

    told = {"axes": ("chirp", "rx", "sample")}
    from_npy = decoded(read(as_npy(tmp_path, of_integers), "npy", **told))
    from_hdf5 = decoded(read(as_hdf5(tmp_path, of_integers), "hdf5", **told))

    assert np.array_equal(from_npy[0] * 32768, sent)
    assert np.array_equal(from_hdf5[0] * 32768, sent)


@pytest.mark.parametrize("kind", ["int16", "uint16", "float32", "float64"])
@pytest.mark.parametrize("is_complex", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_keeps_numbers_in_whatever_type_holds_them(tmp_path, kind, is_complex, compressed):
    numbers = np.random.default_rng(3).integers(0, 200, (4, 2, 8)).astype(kind)
    file = tmp_path / "cube.mat"
    if is_complex and kind.startswith("float"):
        numbers = (numbers + 1j * numbers[::-1]).astype(f"complex{2 * int(kind[5:])}")
    scipy.io.savemat(file, {"cube": numbers}, do_compression=compressed)

    of = radar(sampling="complex" if np.iscomplexobj(numbers) else "real")
    told = {"axes": ("chirp", "rx", "sample"), "encoding": "full-scale"}
    assert np.array_equal(decoded(read(file, "matlab", of, **told))[0], numbers)


def matlab_bytes(kinds, parts, order="<") -> bytes:
    """A variable `x` of class double, whose parts are kept in the given types."""

    def element(kind, data):
        return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)

    numbers = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "f8": 9}
    flags = struct.pack(f"{order}II", 6 | (0x0800 if len(parts) > 1 else 0), 0)
    sizes = struct.pack(f"{order}{parts[0].ndim}i", *parts[0].shape)
    name = struct.pack(f"{order}I", 1 << 16 | 1) + b"x\0\0\0"  # short: within its tag
    body = element(6, flags) + element(5, sizes) + name
    for kind, part in zip(kinds, parts, strict=True):
        body += element(numbers[kind], part.astype(order + kind).tobytes(order="F"))
    mark = b"IM" if order == "<" else b"MI"
    head = b"MATLAB 5.0 MAT-file, by hand".ljust(124, b" ")
    return head + struct.pack(f"{order}H", 0x0100) + mark + element(14, body)


@pytest.mark.parametrize("order", ["<", ">"])
def test_matlab_may_keep_both_parts_in_types_of_their_own(tmp_path, order):
    re, im = np.random.default_rng(4).integers(0, 100, (2, 4, 2, 8))
    (tmp_path / "cube.mat").write_bytes(matlab_bytes(["i2", "u1"], [re, im], order))
    witness = scipy.io.loadmat(tmp_path / "cube.mat")["x"]
    assert np.array_equal(witness, re + 1j * im)

    told = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    cube = decoded(read(tmp_path / "cube.mat", "matlab", **told))

    assert np.array_equal(cube[0] * 32768, re + 1j * im)


# --- Which array ----------------------------------------------------------------------


def several(path) -> dict[str, Path]:
    """Two possible cubes, A and B, in each container."""
    arrays = {"A": integers(4, 2, 8, seed=5), "B": integers(4, 2, 8, seed=6)}
    np.savez(path / "two.npz", **arrays)
    scipy.io.savemat(path / "two.mat", arrays)
    with h5py.File(path / "two.h5", "w") as file:
        group = zarr.create_group(path / "two.zarr")
        for name, array in arrays.items():
            file[name] = array
            group.create_array(name, data=array)
    return {
        kind: path / f"two.{end}"
        for kind, end in {"npz": "npz", "matlab": "mat", "hdf5": "h5", "zarr-array": "zarr"}.items()
    }


@pytest.mark.parametrize("kind", ["npz", "matlab", "hdf5", "zarr-array"])
def test_of_several_arrays_the_named_one_is_read(tmp_path, kind):
    file = several(tmp_path)[kind]
    told = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}

    cube = decoded(read(file, kind, inside="B", **told))
    unnamed = mistake(file, kind, **told)
    misnamed = mistake(file, kind, inside="C", **told)
    # Of a folder, the name is that of a folder in it.
    expected = "a readable file or folder" if kind == "zarr-array" else "array named C"

    assert np.array_equal(cube[0] * 32768, integers(4, 2, 8, seed=6))
    assert "A (complex128 of 4 x 2 x 8), B (complex128 of 4 x 2 x 8)" in unnamed.value
    assert f"{file.name}/A" in unnamed.fix
    assert expected in misnamed.expected


def test_the_radar_tells_a_cube_from_other_arrays(tmp_path):
    sent = integers(4, 2, 8)
    np.savez(tmp_path / "cube.npz", samples=sent, picture=np.zeros((64, 48)))

    told = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    assert np.array_equal(decoded(read(tmp_path / "cube.npz", "npz", **told))[0] * 32768, sent)


def test_a_dataset_is_found_through_a_link_within_the_file(tmp_path):
    sent = integers(4, 2, 8)
    file = as_hdf5(tmp_path, sent)

    told = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    assert np.array_equal(decoded(read(file, "hdf5", inside="link", **told))[0] * 32768, sent)


RESIDENT = """
import re, sys
from pathlib import Path
import numpy as np
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from test_generic_cubes import FORMATS, radar
told = RecordingHints(
    settings=RecordingSettings(radar=radar(n_chirps=2048, n_rx=1, n_samples=64)),
    axes=("chirp", "sample", "frame"),
    encoding="full-scale",
)
def most():  # MiB; what `resource` says begins with the most of who started this
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 2**10
before = most()
out = np.ones((2048, 1, 64), np.complex64)
contents = FORMATS["npy"].read(Path(sys.argv[1]), told)
contents.decode(400, out)
print(most() - before, out.any())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="measured as Linux counts")
def test_frames_that_lie_all_over_a_file_do_not_pull_it_into_memory(tmp_path):
    file, shape = tmp_path / "cube.npy", (2048, 64, 512)
    with file.open("wb") as made:  # 512 MiB that take no room on most disks
        head = npy_header(shape)
        made.write(head)
        made.truncate(len(head) + 8 * math.prod(shape))

    paths = [str(Path(dechirp.__file__).parent.parent), str(Path(__file__).parent)]
    found = subprocess.run(
        [sys.executable, "-c", RESIDENT, str(file)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=True,
    )

    added_mib, any_left = found.stdout.split()
    assert float(added_mib) < 64  # three frames of 1 MiB, blocks of 16 MiB
    assert any_left == "False"


# --- Text -----------------------------------------------------------------------------


def lines(numbers, separator, *, comma=False, end=""):
    rows = (separator.join(repr(float(number)) for number in row) + end for row in numbers)
    return "\n".join(row.replace(".", ",") if comma else row for row in rows) + "\n"


@pytest.mark.parametrize(
    ("separator", "comma"),
    [
        (",", False),
        (", ", False),
        (";", True),
        (";", False),
        ("\t", True),
        (" ", True),
        ("  ", False),
    ],
)
def test_columns_of_text_are_samples_of_a_chirp(tmp_path, separator, comma):
    numbers = np.random.default_rng(7).uniform(-1, 1, (12, 8))
    file = tmp_path / "cube.csv"
    file.write_text(lines(numbers, separator, comma=comma))
    of = radar(n_rx=1, sampling="real")

    contents = read(file, "text-columns", of, axes=("frame", "chirp", "sample"))

    assert np.array_equal(decoded(contents)[:, :, 0], numbers.astype("f4").reshape(3, 4, 8))
    assert contents.findings == ()


def test_names_and_units_above_the_numbers_are_left_out_and_said(tmp_path):
    numbers = np.random.default_rng(8).uniform(-1, 1, (8, 2))  # sample, rx
    file = tmp_path / "scope.csv"
    file.write_bytes(
        b"\xef\xbb\xbfChannel 1;Channel 2\r\n(mV);(mV)\r\n\r\n"
        + lines(numbers, ";", comma=True, end=";").replace("\n", "\r\n").encode()
    )
    of = radar(n_chirps=1, sampling="real")

    contents = read(file, "text-columns", of, axes=("sample", "rx"))

    assert np.array_equal(decoded(contents)[0, 0], numbers.T.astype("f4"))
    assert "2 lines before the first line of numbers" in contents.findings[0].value


def test_columns_of_i_and_q_are_complex_samples(tmp_path):
    sent = integers(8, 8)
    numbers = np.stack([sent.real, sent.imag], axis=-1).reshape(8, 16)
    (tmp_path / "cube.txt").write_text(lines(numbers, " "))
    of = radar(n_rx=1)

    told = {"axes": ("frame", "chirp", "sample", "iq"), "encoding": "int16"}
    cube = decoded(read(tmp_path / "cube.txt", "text-columns", of, **told))

    assert np.array_equal(cube[:, :, 0] * 32768, sent.reshape(2, 4, 8))


def test_text_cut_short_loses_its_last_frame_with_a_warning(tmp_path):
    numbers = np.random.default_rng(9).uniform(-1, 1, (11, 8))
    (tmp_path / "cube.csv").write_text(lines(numbers, ","))
    of = radar(n_rx=1, sampling="real")

    contents = read(tmp_path / "cube.csv", "text-columns", of, axes=("frame", "chirp", "sample"))

    assert (contents.n_frames, contents.findings[0].level) == (2, "warning")


def test_long_text_is_read_from_the_middle(tmp_path):
    # Beyond the places that are remembered, every 64 lines, and with blank lines between.
    numbers = np.random.default_rng(10).integers(-500, 500, (400, 8))
    rows = [
        " ".join(map(str, row)) + ("\n\n" if at % 7 == 0 else "\n")
        for at, row in enumerate(numbers)
    ]
    (tmp_path / "cube.txt").write_text("".join(rows))
    of = radar(n_rx=1, sampling="real")

    told = {"axes": ("frame", "chirp", "sample"), "encoding": "int16"}
    contents = read(tmp_path / "cube.txt", "text-columns", of, **told)
    some = np.empty((4, 1, 8), np.float32)
    contents.decode(73, some)

    assert np.array_equal(some[:, 0] * 32768, numbers[292:296])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("1 2 3 4 5 6 7 8\n1 2 3\n", "line 2 is a row of 3 numbers instead of 8"),
        ("1 2 3 4 5 6 7 8\n" * 3 + "1 2 3 x 5 6 7 8\n", "something else than numbers"),
        ("a b\n" * 150, "not yet a line of numbers"),
        ("a b\n", "no line consists of numbers only"),
        ("1 2 3\n" * 32, "3 numbers in a line"),
        ("1 2 3 4 5 6 7 8\n" * 2, "2 lines of 8 numbers"),
    ],
)
def test_text_that_is_no_cube_says_which_line(tmp_path, text, named):
    (tmp_path / "cube.txt").write_text(text)
    of = radar(n_rx=1, sampling="real")
    told = RecordingHints(
        settings=RecordingSettings(radar=of), axes=("frame", "chirp", "sample"), encoding="int16"
    )

    with pytest.raises(RecordingError) as error:
        decoded(FORMATS["text-columns"].read(tmp_path / "cube.txt", told))

    assert named in str(error.value)


def test_json_is_not_a_table_of_numbers(tmp_path):
    (tmp_path / "said.json").write_text(json.dumps({"sizes": list(range(20))}, indent=1))

    assert FORMATS["text-columns"].recognise(tmp_path / "said.json") == MatchQuality.NO


# --- Our own store --------------------------------------------------------------------


def results(tmp_path, *, n_frames=2) -> tuple[Path, np.ndarray, Radar]:
    """Folder as a run leaves it, written with zarr alone."""
    sent = integers(n_frames, 8, 2, 8).astype(np.complex64)
    text = {
        "frame": {
            "chirp": {
                "start_frequency": "77 GHz",
                "slope": "30 MHz/us",
                "ramp_duration": "20 us",
                "sample_rate": "5 MHz",
                "n_samples": 8,
                "sampling": "complex",
            },
            "n_chirps": 4,
            "interval": "30 us",
            "multiplexing": {"kind": "tdm", "order": [1, 0]},
        },
        "array": {
            "tx": [["0 m", "0 m", "0 m"], ["0 m", "8 mm", "0 m"]],
            "rx": [["0 m", "0 m", "0 m"], ["0 m", "2 mm", "0 m"]],
        },
    }
    said = {"format_version": 1, "radar": text}
    store = zarr.create_group(tmp_path / "run" / "cube.zarr", attributes=said)
    store.create_array(
        "cube",
        shape=sent.shape,
        chunks=(1, *sent.shape[1:]),
        dtype=sent.dtype,
        dimension_names=AXES,
        attributes={"units": "sqrt(W)"},
    )[:] = sent
    return tmp_path / "run", sent, radar(order=(1, 0))


@pytest.mark.parametrize("inside", ["", "cube.zarr"])
def test_results_are_a_recording_with_its_radar_and_units(tmp_path, inside):
    folder, sent, made_by = results(tmp_path)

    assert FORMATS["zarr"].recognise(folder / inside) == MatchQuality.SELF_DESCRIBING
    contents = FORMATS["zarr"].read(folder / inside, RecordingHints())

    assert np.array_equal(decoded(contents), sent)
    assert contents.units == "sqrt(W)"
    assert contents.radar == made_by


def test_results_kept_as_scaled_integers_are_samples_again(tmp_path):
    folder, sent, _ = results(tmp_path)
    group = zarr.open_group(folder / "cube.zarr")
    del group["cube"]
    parts = np.stack([sent.real, sent.imag], axis=-1).astype(np.int16)
    attributes = {"units": "full scale", "scale": 2**-15}
    group.create_array("cube", data=parts, dimension_names=(*AXES, "iq"), attributes=attributes)

    contents = FORMATS["zarr"].read(folder, RecordingHints())

    assert np.array_equal(decoded(contents) * 32768, sent)
    assert contents.units == "full scale"


@pytest.mark.parametrize("named", ["format version", "unreadable radar", "not readable"])
def test_results_that_cannot_be_trusted_are_refused(tmp_path, named):
    folder, _, _ = results(tmp_path)
    mark = folder / "cube.zarr" / "zarr.json"
    said = json.loads(mark.read_text())
    if named == "format version":
        said["attributes"]["format_version"] = 2
    elif named == "not readable":
        (folder / "cube.zarr" / "cube" / "zarr.json").unlink()
    else:
        said["attributes"]["radar"]["frame"]["n_chirps"] = "many"
    mark.write_text(json.dumps(said))

    with pytest.raises(RecordingError, match=named):
        FORMATS["zarr"].read(folder, RecordingHints())


def test_results_open_as_the_cube_that_was_simulated(tmp_path):
    folder, sent, made_by = results(tmp_path)

    opened = open_recording(folder)

    assert opened.format == "zarr"
    assert np.array_equal(opened.cube.values, sent)
    assert opened.cube.attrs["units"] == "sqrt(W)"
    assert opened.cube.transmitter.values.tolist() == [1, 0] * 4
    assert opened.radar == made_by


# --- Bare numbers, and data sets ------------------------------------------------------


def words(samples) -> bytes:
    return np.stack([samples.real, samples.imag], axis=-1).astype("<i2").tobytes()


def test_bare_numbers_are_cut_by_the_radar(tmp_path):
    sent = integers(3, 2, 4, 8)  # frame, rx, chirp, sample
    (tmp_path / "cube.raw").write_bytes(words(sent) + b"\1\2\3\4")

    contents = read(
        tmp_path / "cube.raw", "bare-cube", axes=("frame", "rx", "chirp", "sample", "iq")
    )

    assert np.array_equal(decoded(contents) * 32768, sent.swapaxes(1, 2))
    assert "2 numbers left out" in contents.findings[0].value


def test_bare_numbers_of_no_whole_frame_are_refused(tmp_path):
    (tmp_path / "cube.raw").write_bytes(bytes(100))

    wrong = mistake(tmp_path / "cube.raw", "bare-cube", axes=("chirp", "rx", "sample", "iq"))

    assert "a file of 100 bytes" in wrong.value
    assert "128 numbers: 4 chirp x 2 rx x 8 sample x 2 iq" in wrong.expected


@pytest.mark.parametrize("encoding", ["int16", "uint16-wrapped", "offset-binary"])
def test_bare_numbers_are_read_in_each_encoding(tmp_path, encoding):
    sent = integers(4, 2, 8)
    content = words(sent)
    if encoding == "offset-binary":
        content = words(sent + 32768 * (1 + 1j))
    (tmp_path / "cube.raw").write_bytes(content)

    told = {"axes": ("chirp", "rx", "sample", "iq"), "encoding": encoding}
    assert np.array_equal(
        decoded(read(tmp_path / "cube.raw", "bare-cube", **told))[0] * 32768, sent
    )


def coloradar(path, by_tx):
    (path / "frame_0.bin").write_bytes(words(by_tx.transpose(1, 2, 0, 3)))
    return path / "frame_0.bin"


def raddet(path, by_tx):
    np.save(path / "000001.npy", by_tx.transpose(3, 0, 2, 1))
    return path / "000001.npy"


def radical(path, by_tx):
    with h5py.File(path / "scene.h5", "w") as file:
        file["radar"] = by_tx.reshape(1, len(by_tx), -1, by_tx.shape[-1])
        file["rgb"] = np.zeros((1, 8, 8, 3), np.uint8)
    return path / "scene.h5"


@pytest.mark.parametrize("made", [coloradar, raddet, radical], ids=lambda made: made.__name__)
def test_a_data_set_is_read_as_documented_with_a_warning(tmp_path, made):
    by_tx = integers(4, 3, 2, 8)  # chirp, tx, rx, sample
    kind, of = made.__name__, radar(order=(1, 0, 2))
    told = {} if kind == "coloradar" else {"encoding": "int16"}

    contents = read(made(tmp_path, by_tx), kind, of, **told)

    cube = decoded(contents)
    for slot, transmitter in enumerate((1, 0, 2)):
        assert np.array_equal(cube[0, slot::3] * 32768, by_tx[:, transmitter])
    assert "never checked on a real file" in contents.findings[-1].value


def test_four_chips_of_radial_are_one_transmitter_with_16_receivers(tmp_path):
    sent = integers(4, 16, 8)
    for chip in range(4):
        mine = sent[:, 4 * chip : 4 * chip + 4]
        (tmp_path / f"adc{chip}.bin").write_bytes(words(mine))
    of = Radar(frame=radar().frame)

    for path in (tmp_path, tmp_path / "adc0.bin"):
        contents = read(path, "radial", of)
        assert np.array_equal(decoded(contents)[0] * 32768, sent)
        assert contents.radar.array.n_rx == 16
        assert "12 simultaneous transmitters" in contents.findings[-2].value
        assert "experimental" in contents.findings[-1].value


def test_readers_never_tried_on_a_real_file_are_listed_as_experimental(capsys):
    assert {kind for kind, member in FORMATS.items() if member.experimental} == {
        *("coloradar", "raddet", "radial", "radical")
    }

    list_members("format", as_json=True)

    members = json.loads(capsys.readouterr().out)["families"]["format"]
    assert {kind for kind, member in members.items() if member["experimental"]} == {
        *("coloradar", "raddet", "radial", "radical")
    }
    list_members("format")
    assert "raddet (experimental)" in capsys.readouterr().out


def test_formats_that_nothing_gives_away_have_to_be_named():
    kinds = {kind for kind, member in FORMATS.items() if member.must_be_named}

    assert {"bare-cube", "coloradar", "radial", "radical", "raddet"} <= kinds
    assert not kinds & {"npy", "npz", "matlab", "hdf5", "zarr-array", "text-columns", "zarr"}


# --- What is missing ------------------------------------------------------------------


def test_chunks_that_were_never_written_are_gaps_and_zero(tmp_path):
    sent = integers(3, 4, 2, 8)
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        made = file.create_dataset("cube", sent.shape, "c8", chunks=(1, 2, 2, 8))
        made[:2] = sent[:2]
        made[2, :2] = sent[2, :2]
    group = zarr.create_array(
        tmp_path / "cube.zarr", shape=sent.shape, chunks=(1, 2, 1, 8), dtype="c8"
    )
    group[:] = sent
    for rx in range(2):
        (tmp_path / "cube.zarr" / "c" / "2" / "1" / str(rx) / "0").unlink()

    expected = sent.copy()
    expected[2, 2:] = 0
    for file, kind in ((tmp_path / "cube.h5", "hdf5"), (tmp_path / "cube.zarr", "zarr-array")):
        contents = read(file, kind, axes=AXES, encoding="int16")
        assert np.array_equal(decoded(contents) * 32768, expected)
        assert np.argwhere(contents.gaps).tolist() == [[2, 2], [2, 3]]
        assert "2 of 12 chirps have gaps, the first in frame 2" in contents.findings[-1].value


def test_a_chirp_with_a_lost_part_is_lost_for_all_receivers(tmp_path):
    by_tx = integers(4, 2, 2, 8)
    array = zarr.create_array(
        tmp_path / "cube.zarr", shape=by_tx.shape, chunks=(2, 1, 1, 8), dtype="c8"
    )
    array[:] = by_tx
    (tmp_path / "cube.zarr" / "c" / "1" / "0" / "1" / "0").unlink()  # chirps 2, 3 of tx 0, rx 1

    told = {"axes": ("chirp", "tx", "rx", "sample"), "encoding": "int16"}
    contents = read(tmp_path / "cube.zarr", "zarr-array", radar(order=(0, 1)), **told)

    assert np.flatnonzero(contents.gaps[0]).tolist() == [4, 5, 6, 7]


# --- Files that are not what they should be -------------------------------------------


def spring():
    pytest.fail("a pickle in a recording was opened")


class Trap:
    """Calls `spring` when unpickled."""

    def __reduce__(self):
        return spring, ()


def trapped(*shape):
    objects = np.empty(shape, object)
    objects[:] = Trap()
    return objects


def test_pickled_objects_in_an_archive_are_never_opened(tmp_path):
    np.savez(tmp_path / "cube.npz", cube=trapped(4, 2, 8))

    wrong = mistake(tmp_path / "cube.npz", "npz", axes=("chirp", "rx", "sample"))

    assert "cube (object of 4 x 2 x 8)" in wrong.value


def test_a_codec_that_unpickles_is_never_used(tmp_path):
    array = zarr.create_array(
        tmp_path / "cube.zarr", shape=(4, 2, 8), chunks=(4, 2, 8), dtype="c8", zarr_format=2
    )
    array[:] = 1
    mark = tmp_path / "cube.zarr" / ".zarray"
    said = json.loads(mark.read_text())
    mark.write_text(json.dumps({**said, "filters": [{"id": "pickle"}]}))
    (tmp_path / "cube.zarr" / "0.0.0").write_bytes(pickle.dumps(Trap()))

    wrong = mistake(tmp_path / "cube.zarr", "zarr-array", axes=("chirp", "rx", "sample"))

    assert "codec pickle" in wrong.value


def test_cells_and_texts_of_matlab_are_no_cubes(tmp_path):
    cells = np.empty((4, 8), object)
    cells[:] = 1.0
    scipy.io.savemat(tmp_path / "cube.mat", {"cells": cells, "text": ["abcdefgh"] * 4})

    assert "no array" in mistake(tmp_path / "cube.mat", "matlab", axes=("chirp", "sample")).value


def test_nothing_is_read_from_other_files(tmp_path):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["cube"] = integers(4, 2, 8)
    (tmp_path / "secret.raw").write_bytes(bytes(1024))
    layout = h5py.VirtualLayout((4, 2, 8), "c16")
    layout[:] = h5py.VirtualSource(str(secret), "cube", (4, 2, 8))
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file["linked"] = h5py.ExternalLink("secret.h5", "/cube")
        file["by way of"] = h5py.SoftLink("/linked")
        file["dangling"] = h5py.SoftLink("/nowhere")
        file["round"] = h5py.SoftLink("/round")
        file.create_virtual_dataset("virtual", layout)
        outside = [(str(tmp_path / "secret.raw"), 0, 1024)]
        file.create_dataset("outside", (4, 2, 8), "c16", external=outside)

    def refused(name):
        told = {"axes": ("chirp", "rx", "sample"), "encoding": "full-scale"}
        return mistake(tmp_path / "cube.h5", "hdf5", inside=name, **told).value

    assert "link to secret.h5" in refused("linked")
    assert "link to secret.h5" in refused("by way of")
    assert "virtual dataset" in refused("virtual")
    assert "external storage" in refused("outside")
    for name in ("dangling", "round", "linked/cube", "virtual/x"):
        assert "a file with" in refused(name) or "link" in refused(name)


def test_a_zarr_folder_may_not_lead_out_of_itself(tmp_path):
    for name in ("cube", "secret"):
        array = zarr.create_array(
            tmp_path / f"{name}.zarr", shape=(4, 2, 8), chunks=(2, 2, 8), dtype="c8"
        )
        array[:] = 1
    chunk = tmp_path / "cube.zarr" / "c" / "0" / "0" / "0"
    chunk.unlink()
    chunk.symlink_to(tmp_path / "secret.zarr" / "c" / "0" / "0" / "0")
    group = tmp_path / "group.zarr"
    zarr.create_group(group)
    (group / "cube").symlink_to(tmp_path / "secret.zarr")

    told = {"axes": ("chirp", "rx", "sample")}
    assert "c/0/0/0 is a link" in mistake(tmp_path / "cube.zarr", "zarr-array", **told).value
    assert "no array" in mistake(group, "zarr-array", **told).value


def test_absurd_shapes_are_refused_before_anything_is_allocated(tmp_path):
    absurd = (10**6, 4, 10**6, 8)
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file.create_dataset("cube", absurd, "c8", chunks=(1, 4, 2, 8))
        large = (26, 2**17, 1, 8)  # 208 MiB
        made = file.create_dataset("piece", large, "c8", chunks=large, compression="gzip")
        made.id.write_direct_chunk((0, 0, 0, 0), zlib.compress(bytes(208 * 2**20), 1))
    zarr.create_array(tmp_path / "cube.zarr", shape=absurd, chunks=(1, 4, 2, 8), dtype="c8")
    zarr.create_array(tmp_path / "piece.zarr", shape=absurd, chunks=absurd, dtype="c8")
    with zipfile.ZipFile(tmp_path / "cube.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("cube.npy", npy_header(absurd) + bytes(512))
    scipy.io.savemat(tmp_path / "cube.mat", {"cube": np.zeros((4, 2, 8))})
    content = (tmp_path / "cube.mat").read_bytes()
    sizes = struct.pack("<3i", 4, 2, 8)
    assert sizes in content
    (tmp_path / "cube.mat").write_bytes(content.replace(sizes, struct.pack("<3i", 2**30, 2**30, 8)))

    told = {"axes": AXES}
    for name, kind in (("cube.h5", "hdf5"), ("cube.npz", "npz"), ("cube.zarr", "zarr-array")):
        inside = "cube" if kind == "hdf5" else None
        wrong = mistake(tmp_path / name, kind, inside=inside, **told)
        assert "bytes" in wrong.value
    assert "chunks" in mistake(tmp_path / "cube.h5", "hdf5", inside="piece", **told).value
    assert "bytes" in mistake(tmp_path / "piece.zarr", "zarr-array", **told).value
    assert "1024" not in mistake(tmp_path / "cube.mat", "matlab", axes=AXES[1:]).expected


def npy_header(shape) -> bytes:
    text = f"{{'descr': '<c8', 'fortran_order': False, 'shape': {shape}}}\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def test_a_bomb_is_refused_or_read_a_frame_at_a_time(tmp_path):
    file, shape = tmp_path / "cube.npz", (40, 2**17, 8)  # 320 MiB of zeros, in 0.3 MiB
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("cube.npy", "w") as member,
    ):
        member.write(npy_header(shape))
        for _ in range(shape[0]):
            member.write(bytes(2**23))
    assert file.stat().st_size < 2**20

    few, many = radar(n_chirps=40, n_rx=1), radar(n_chirps=2**17, n_rx=1)
    wrong = mistake(file, "npz", few, axes=("chirp", "frame", "sample"))
    contents = read(file, "npz", many, axes=("frame", "chirp", "sample"))
    out = np.full((2**17, 1, 8), 1, np.complex64)
    contents.decode(7, out)

    assert "335544320 bytes to decompress" in wrong.value
    assert not out.any()


# --- What a look at the first frame, or at the header, cannot tell ----------------------


def test_a_silent_first_frame_does_not_tell_the_encoding(tmp_path):
    numbers = np.zeros((2, 4, 2, 8))
    numbers[1] = 1234
    file = as_npy(tmp_path, numbers)

    wrong = mistake(file, "npy", radar(sampling="real"), axes=AXES)

    assert "up to 1234 in frame 1 without an encoding" in wrong.value


@pytest.mark.parametrize("how", [{}, {"shuffle": True, "fletcher32": True}])
def test_a_chunk_that_unpacks_to_more_than_a_chunk_is_refused(tmp_path, how):
    sent = integers(3, 4, 2, 8)
    file = as_hdf5(tmp_path, sent, compression="gzip", chunks=(1, 4, 2, 8), **how)
    told = {"axes": AXES, "encoding": "int16"}
    assert np.array_equal(decoded(read(file, "hdf5", **told)) * 32768, sent)

    with h5py.File(file, "r+") as made:  # 100 kB that would become 100 MB
        samples = made["scene/radar/samples"]
        samples.id.write_direct_chunk((1, 0, 0, 0), zlib.compress(bytes(10**8)))

    assert "decompresses to more than" in mistake(file, "hdf5", **told).value


@pytest.mark.parametrize("how", [{}, {"shuffle": True, "fletcher32": True}])
@pytest.mark.parametrize("packer", ["lzf", "szip"])
def test_a_chunk_of_another_compression_is_held_to_its_size_too(tmp_path, packer, how):
    sent = np.arange(192, dtype="<i2").reshape(3, 4, 2, 8) >> 2
    file = as_hdf5(tmp_path, sent, compression=packer, chunks=(1, 4, 2, 8), **how)
    told = {"of": radar(sampling="real"), "axes": AXES, "encoding": "int16"}
    assert np.array_equal(decoded(read(file, "hdf5", **told)) * 32768, sent)

    if packer == "lzf":  # a zero, and then 264 as the one before, over and over: 5 MB of 60 kB
        bomb = b"\0\0" + b"\xe0\xff\0" * 20_000
    else:  # the size that it says
        bomb = struct.pack("<I", 2**31) + bytes(100)
    with h5py.File(file, "r+") as made:
        made["scene/radar/samples"].id.write_direct_chunk((1, 0, 0, 0), bomb + bytes(4))

    assert "decompresses to more than" in mistake(file, "hdf5", **told).value


def many_zeros(n_bytes):
    """Zeros as a stream of Zstandard: one repeated a whole block long, over and over."""
    blocks = [struct.pack("<I", 2**17 << 3 | 2)[:3] + b"\0"] * (n_bytes >> 17)
    blocks[-1] = bytes([blocks[-1][0] | 1]) + blocks[-1][1:]
    return b"\x28\xb5\x2f\xfd\0\x58" + b"".join(blocks)


PACKERS = {  # of Zarr 2, with what makes a bomb of 50 MB
    "blosc": (numcodecs.Blosc("lz4"), numcodecs.Blosc("lz4").encode),
    "zstd": (numcodecs.Zstd(), numcodecs.Zstd().encode),
    "streamed zstd": (numcodecs.Zstd(), lambda zeros: many_zeros(len(zeros))),
    "zstd in two frames": (
        numcodecs.Zstd(),
        lambda zeros: numcodecs.Zstd().encode(zeros[:1024]) + numcodecs.Zstd().encode(zeros),
    ),
    "gzip": (numcodecs.GZip(), numcodecs.GZip().encode),
    "gzip in two members": (
        numcodecs.GZip(),
        lambda zeros: gzip.compress(zeros[:1024]) + gzip.compress(zeros),
    ),
    "zlib": (numcodecs.Zlib(), numcodecs.Zlib().encode),
    "lz4": (numcodecs.LZ4(), numcodecs.LZ4().encode),
    "bz2": (numcodecs.BZ2(), numcodecs.BZ2().encode),
    "lzma": (numcodecs.LZMA(), numcodecs.LZMA().encode),
}


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("packer", PACKERS)
def test_a_zarr_chunk_that_unpacks_to_more_than_a_chunk_is_refused(tmp_path, packer, filtered):
    sent, told = integers(3, 4, 2, 8), {"axes": AXES, "encoding": "int16"}
    codec, bomb = PACKERS[packer]
    folder = tmp_path / "cube.zarr"
    array = zarr.create_array(
        folder,
        shape=sent.shape,
        chunks=(1, 4, 2, 8),
        dtype="c16",
        zarr_format=2,
        filters=[numcodecs.Delta("c16"), numcodecs.Shuffle(16)] if filtered else None,
        compressors=codec,
    )
    array[:] = sent
    assert np.array_equal(decoded(read(folder, "zarr-array", **told)) * 32768, sent)

    (folder / "1.0.0.0").write_bytes(bomb(bytes(50_000_000)))

    assert "decompresses to more than 1024" in mistake(folder, "zarr-array", **told).value


@pytest.mark.parametrize("checked", [False, True])
def test_frames_of_a_zarr_chunk_that_was_streamed_are_read(tmp_path, checked):
    folder = tmp_path / "cube.zarr"
    packers = [zarr.codecs.ZstdCodec(), *([zarr.codecs.Crc32cCodec()] if checked else [])]
    of = radar(n_chirps=2**14, n_rx=1)
    array = zarr.create_array(  # of 2**20 bytes
        folder, shape=(1, 2**14, 8), chunks=(1, 2**14, 8), dtype="c8", compressors=packers
    )
    array[:] = 1
    content = many_zeros(2**20)
    if checked:
        content += numcodecs.CRC32C(location="end").encode(content)[-4:].tobytes()
    (folder / "c" / "0" / "0" / "0").write_bytes(content)

    cube = decoded(read(folder, "zarr-array", of, axes=("frame", "chirp", "sample")))

    assert not cube.any()


V3 = {
    "zstd": zarr.codecs.ZstdCodec(),
    "zstd with a checksum": zarr.codecs.ZstdCodec(checksum=True),
    "blosc": zarr.codecs.BloscCodec(),
    "gzip": zarr.codecs.GzipCodec(),
}


@pytest.mark.parametrize("checked", [False, True])
@pytest.mark.parametrize("index_location", ["start", "end", None])
@pytest.mark.parametrize("packer", V3)
def test_a_piece_of_a_shard_is_held_to_its_size_too(tmp_path, packer, index_location, checked):
    sent, told = integers(3, 4, 2, 8), {"axes": AXES, "encoding": "int16"}
    packers = [V3[packer], *([zarr.codecs.Crc32cCodec()] if checked else [])]
    inner = [zarr.codecs.BytesCodec(), *packers]
    sharded = zarr.codecs.ShardingCodec(
        chunk_shape=(1, 2, 2, 8), codecs=inner, index_location=index_location or "end"
    )

    def made(name, n_chirps):
        folder = tmp_path / name
        array = zarr.create_array(
            folder,
            shape=(3, n_chirps, 2, 8),
            chunks=(1, n_chirps, 2, 8),
            dtype="c16",
            serializer=sharded if index_location else zarr.codecs.BytesCodec(),
            compressors=None if index_location else packers,
        )
        array[:] = sent if n_chirps == 4 else 1j
        return folder

    folder = made("cube.zarr", 4)
    assert np.array_equal(decoded(read(folder, "zarr-array", **told)) * 32768, sent)

    # Two pieces of 2 chirps, each as one of 10**5.
    sharded = zarr.codecs.ShardingCodec(
        chunk_shape=(1, 10**5, 2, 8), codecs=inner, index_location=index_location or "end"
    )
    bomb = made("bomb.zarr", 2 * 10**5) / "c" / "1" / "0" / "0" / "0"
    (folder / "c" / "1" / "0" / "0" / "0").write_bytes(bomb.read_bytes())

    assert "decompresses to more than" in mistake(folder, "zarr-array", **told).value


def test_what_makes_other_sizes_than_were_compressed_is_refused_by_its_name(tmp_path):
    def refused(name, **how):
        zarr.create_array(tmp_path / name, shape=(4, 2, 8), chunks=(4, 2, 8), dtype="f4", **how)[
            :
        ] = 1
        of = radar(sampling="real")
        return mistake(tmp_path / name, "zarr-array", of, axes=("chirp", "rx", "sample")).value

    shrunk = [numcodecs.FixedScaleOffset(offset=0, scale=10, dtype="f4", astype="i2")]
    packers = [zarr.codecs.GzipCodec(), zarr.codecs.ZstdCodec()]
    nested = zarr.codecs.ShardingCodec(
        chunk_shape=(2, 2, 8), codecs=[zarr.codecs.ShardingCodec(chunk_shape=(1, 2, 8))]
    )

    assert "zstd after gzip" in refused("a.zarr", compressors=packers)
    assert "fixedscaleoffset" in refused("b.zarr", zarr_format=2, filters=shrunk)
    assert "sharding_indexed" in refused("c.zarr", serializer=nested, compressors=None)
    assert "zlib" in refused(
        "d.zarr", zarr_format=2, filters=[numcodecs.Zlib()], compressors=numcodecs.Zlib()
    )


def test_an_archive_of_a_million_members_is_refused_before_they_are_listed(tmp_path):
    member = b"PK\1\2" + struct.pack("<6H3I5H2I", *[20, 20], *[0] * 7, 1, *[0] * 6) + b"a"
    listed = member * 10**6
    end = b"PK\5\6" + struct.pack("<4H2IH", 0, 0, 65535, 65535, len(listed), 30, 0)
    file = tmp_path / "cube.npz"
    file.write_bytes(b"PK\3\4" + bytes(26) + listed + end)

    assert "member list of 47000000 bytes" in mistake(file, "npz", axes=AXES).value


def test_what_was_compressed_twice_is_refused(tmp_path):
    made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    made.set_chunk((4, 2, 8))
    for _ in range(2):
        made.set_filter(h5py.h5z.FILTER_DEFLATE, 0, (9,))
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        space, kind = h5py.h5s.create_simple((4, 2, 8)), h5py.h5t.py_create(np.dtype("c16"))
        dataset = h5py.h5d.create(file.id, b"samples", kind, space, made)
        h5py.Dataset(dataset)[...] = 0.5

    wrong = mistake(tmp_path / "cube.h5", "hdf5", axes=AXES[1:])

    assert "filters [1, 1]" in wrong.value


def test_a_pipe_in_the_place_of_a_chunk_is_not_waited_for(tmp_path):
    folder = as_zarr(tmp_path, integers(3, 4, 2, 8))
    chunk = folder / "samples" / "c" / "0" / "0" / "0" / "0"
    chunk.unlink()
    os.mkfifo(chunk)

    assert "neither a file nor a folder" in mistake(folder, "zarr-array", axes=AXES).value


def test_compressed_frames_that_do_not_lie_one_after_the_other_are_called_slow(tmp_path):
    of = radar(n_chirps=64, n_rx=4, n_samples=64, sampling="real")
    frames_last = np.zeros((64, 4, 64, 1100), np.float32)  # 72 MB: more than is kept
    file = as_npz(tmp_path, frames_last, save=np.savez_compressed)
    told = {"axes": ("chirp", "rx", "sample", "frame")}

    (note,) = read(file, "npz", of, inside="samples", **told).findings

    assert "decompressed again for each of 1100 frames" in note.value


def test_half_a_number_at_the_end_of_bare_ones_is_refused(tmp_path):
    numbers = np.zeros((4, 2, 8, 2), "<i2")
    (tmp_path / "cube.bin").write_bytes(numbers.tobytes() + b"x")

    wrong = mistake(tmp_path / "cube.bin", "bare-cube", axes=("chirp", "rx", "sample", "iq"))

    assert wrong.value == "257 bytes"


def test_bare_frames_of_receivers_that_nobody_told_are_pointed_out(tmp_path):
    (tmp_path / "cube.bin").write_bytes(np.zeros((3, 4, 2, 8, 2), "<i2").tobytes())
    untold = Radar(frame=radar().frame)

    contents = read(tmp_path / "cube.bin", "bare-cube", untold, axes=(*AXES, "iq"))

    assert contents.n_frames == 6
    assert [finding.setting for finding in contents.findings] == ["radar.array.rx"]
