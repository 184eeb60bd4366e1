"""Cubes in generic containers without radar metadata, read with axes given by the user.

The files are written by the libraries of their formats, or byte by byte, never with the package.
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
from dechirp.core.text import format_si
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.recognise import recognise_formats
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.base import RecordingSettings
from nightly import nightly, nightly_except

FORMATS = {kind: member() for kind, member in Format.members().items()}
AXES = ("frame", "chirp", "rx", "sample")


def make_radar(*, n_chirps=4, n_rx=2, n_samples=8, sampling="complex", order=None) -> Radar:
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


def read_contents(path, kind, radar=None, *, inner_name=None, **options) -> Contents:
    """Open a file; name its format only if the content does not identify it."""
    recording = open_recording(
        path if inner_name is None else path / inner_name,
        radar=radar or make_radar(),
        format=kind if FORMATS[kind].must_be_named else None,
        **options,
    )
    assert recording.format == kind
    return recording.contents


def decode_frames(contents: Contents) -> np.ndarray:
    """Decode all frames, (frame, chirp, rx, sample)."""
    frame, n_rx = contents.radar.frame, contents.radar.array.n_rx
    dtype = np.complex64 if frame.chirp.sampling == "complex" else np.float32
    shape = (contents.n_frames, frame.n_chirps_total, n_rx, frame.chirp.n_samples)
    cube = np.full(shape, np.nan, dtype)
    for index in range(contents.n_frames):
        contents.decode(index, cube[index])
    return cube


def catch_mistake(path, kind, radar=None, **options):
    """Return the single mistake that opening or decoding a recording raises."""
    with pytest.raises(RecordingError) as error:
        decode_frames(read_contents(path, kind, radar, **options))
    (mistake,) = error.value.mistakes
    return mistake


def draw_samples(*shape, seed=1):
    re, im = np.random.default_rng(seed).integers(-32768, 32768, size=(2, *shape))
    return re + 1j * im


def pack_pairs(samples, names=("real", "imag"), dtype=np.float32):
    array = np.empty(samples.shape, [(name, dtype) for name in names])
    array[names[0]], array[names[1]] = samples.real, samples.imag
    return array


# --- Equal cubes in every container ---------------------------------------------------


def write_npy(path, cube):
    np.save(path / "cube.npy", cube)
    return path / "cube.npy"


def write_npz(path, cube, *, save=np.savez):
    save(path / "cube.npz", samples=cube, times=np.arange(3.0))
    return path / "cube.npz"


def write_compressed_npz(path, cube):
    return write_npz(path, cube, save=np.savez_compressed)


def write_matlab_5(path, cube, *, compressed=False):
    file = path / "cube.mat"
    scipy.io.savemat(
        file, {"info": {"fs": 5e6}, "samples": cube, "name": "x"}, do_compression=compressed
    )
    return file


def write_compressed_matlab_5(path, cube):
    return write_matlab_5(path, cube, compressed=True)


def write_matlab_7_3(path, cube):
    file = path / "cube.mat"
    with h5py.File(file, "w", userblock_size=512) as file_content:
        dataset = file_content.create_dataset(
            "samples", data=pack_pairs(cube.T, dtype=np.float64), chunks=True
        )
        dataset.attrs["MATLAB_class"] = np.bytes_("double")
        name = file_content.create_dataset("name", data=np.full((8, 4), 65, np.uint16))
        name.attrs["MATLAB_class"] = np.bytes_("char")
    content = file.read_bytes()
    file.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b" ") + content[512:])
    return file


def write_hdf5(path, cube, **storage_options):
    with h5py.File(path / "cube.h5", "w") as file:
        file.create_dataset("scene/radar/samples", data=cube, **storage_options)
        file["times"] = np.arange(3.0)
        file["link"] = h5py.SoftLink("/scene/radar/samples")
    return path / "cube.h5"


def write_compressed_hdf5(path, cube):
    return write_hdf5(path, cube, compression="gzip", chunks=True)


def write_zarr(path, cube, *, zarr_format=3):
    group = zarr.create_group(path / "cube.zarr", zarr_format=zarr_format)
    chunks = tuple(-(-size // 2) for size in cube.shape)
    group.create_array("samples", shape=cube.shape, chunks=chunks, dtype=cube.dtype)[:] = cube
    group.create_array("times", data=np.arange(3.0))
    return path / "cube.zarr"


def write_zarr_2(path, cube):
    return write_zarr(path, cube, zarr_format=2)


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
}


@pytest.fixture(params=FORMAT_BY_WRITER, ids=lambda writer: writer.__name__.removeprefix("write_"))
def write_cube(request):
    return request.param


@pytest.mark.parametrize(
    "axes",
    [AXES, ("sample", "rx", "chirp", "frame"), ("rx", "frame", "sample", "chirp")],
    ids=",".join,
)
def test_every_container_decodes_to_stored_cube(tmp_path, write_cube, axes):
    samples = draw_samples(3, 4, 2, 8)
    file = write_cube(tmp_path, np.transpose(samples, [AXES.index(name) for name in axes]))

    contents = read_contents(file, FORMAT_BY_WRITER[write_cube], axes=axes, encoding="int16")

    cube = decode_frames(contents)
    # 16-bit integers over 32768 are exact in float32.
    assert np.array_equal(cube * 32768, samples)
    repeated = np.empty_like(cube[0])
    contents.decode(0, repeated)  # the first frame again, after the last
    assert np.array_equal(repeated, cube[0])
    assert contents.gaps is None


def make_bpm_radar() -> Radar:
    """Make a radar with two transmitters that are active in every chirp."""
    tdm_radar = make_radar(order=(0, 1))
    return replace(tdm_radar, frame=replace(tdm_radar.frame, multiplexing=Bpm(order=(0, 1))))


def test_bpm_chirps_are_read_in_transmit_order(tmp_path):
    np.save(tmp_path / "cube.npy", draw_samples(8, 2, 8))

    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    cube = decode_frames(read_contents(tmp_path / "cube.npy", "npy", make_bpm_radar(), **options))

    assert np.array_equal(cube[0] * 32768, draw_samples(8, 2, 8))


@pytest.mark.parametrize("axes", [("chirp", "tx", "rx", "sample"), ("chirp", "element", "sample")])
def test_rejects_transmitter_axis_for_simultaneous_transmitters(tmp_path, axes):
    sizes = {"chirp": 4, "tx": 2, "rx": 2, "element": 4, "sample": 8}
    np.save(tmp_path / "cube.npy", draw_samples(*(sizes[name] for name in axes)))

    with pytest.raises(RecordingError, match="several transmitters send in each chirp"):
        read_contents(tmp_path / "cube.npy", "npy", make_bpm_radar(), axes=axes, encoding="int16")


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize(
    "names",
    nightly_except(
        ["rx,sample,tx,chirp", "element"], ["chirp,tx,rx,sample", "rx,sample,tx,chirp", "element"]
    ),
)
def test_tdm_transmitter_axis_is_sorted_by_transmit_order(tmp_path, write_cube, order, names):
    by_tx = draw_samples(4, 3, 2, 8)  # chirp, tx, rx, sample
    if names == "element":
        names = "chirp,element,sample"
        array = by_tx.reshape(4, 6, 8)
    else:
        axes = ["chirp", "tx", "rx", "sample"]
        array = np.transpose(by_tx, [axes.index(name) for name in names.split(",")])

    file = write_cube(tmp_path, array)
    options = {"axes": tuple(names.split(",")), "encoding": "int16"}
    cube = decode_frames(
        read_contents(file, FORMAT_BY_WRITER[write_cube], make_radar(order=order), **options)
    )

    for slot, transmitter in enumerate(order):
        assert np.array_equal(cube[0, slot::3] * 32768, by_tx[:, transmitter])


def test_chirp_axis_without_transmitter_axis_keeps_transmit_order(tmp_path):
    samples = draw_samples(12, 2, 8)
    file = write_npy(tmp_path, samples)

    radar = make_radar(order=(2, 0, 1))
    cube = decode_frames(
        read_contents(file, "npy", radar, axes=("chirp", "rx", "sample"), encoding="int16")
    )

    assert np.array_equal(cube[0] * 32768, samples)


def test_snapshot_needs_no_frame_or_chirp_axis(tmp_path):
    samples = draw_samples(6, 8)
    file = write_matlab_5(tmp_path, samples)

    radar = make_radar(n_chirps=1, order=(0, 1, 2))
    cube = decode_frames(
        read_contents(file, "matlab", radar, axes=("element", "sample"), encoding="int16")
    )

    assert np.array_equal(cube[0] * 32768, samples.reshape(3, 2, 8))


@pytest.mark.parametrize("names", [("real", "imag"), ("re", "im"), ("r", "i"), ("Imag", "Real")])
def test_real_and_imaginary_fields_become_complex_numbers(tmp_path, names):
    samples = draw_samples(4, 2, 8)
    integer_pairs = pack_pairs(
        samples if names[0] != "Imag" else samples.imag + 1j * samples.real, names, "<i2"
    )

    options = {"axes": ("chirp", "rx", "sample")}
    from_npy = decode_frames(read_contents(write_npy(tmp_path, integer_pairs), "npy", **options))
    from_hdf5 = decode_frames(read_contents(write_hdf5(tmp_path, integer_pairs), "hdf5", **options))

    assert np.array_equal(from_npy[0] * 32768, samples)
    assert np.array_equal(from_hdf5[0] * 32768, samples)


@pytest.mark.parametrize("axes", ["element,sample", "rx,sample"])
def test_real_samples_times_a_phase_of_each_channel_open_as_real_with_calibration(tmp_path, axes):
    rng = np.random.default_rng(12)
    real = rng.normal(size=(6, 64)) / 8
    phases = rng.uniform(-np.pi, np.pi, 6)
    stored = real * np.exp(1j * phases)[:, None]
    file = tmp_path / "calibrated.npy"
    np.save(file, stored)
    order, n_rx = ((1, 0), 3) if axes.startswith("element") else (None, 6)
    radar = make_radar(n_chirps=1, n_rx=n_rx, n_samples=64, sampling="real", order=order)

    recording = open_recording(file, radar=radar, axes=axes)

    cube = recording.cube.isel(frame=0).transpose("chirp", "rx", "sample").values
    by_element = cube[list(order)] if order else cube  # chirps are sent as 1, 0
    corrected = recording.radar.element_corrections[:, None] * by_element.reshape(6, 64)
    assert cube.dtype == np.float32 and np.allclose(corrected, stored, atol=1e-6)
    assert [f.setting for f in recording.findings if f.level == "note"] == ["radar.calibration"]

    np.save(file, stored + 0.01j * rng.normal(size=(6, 64)))
    with pytest.raises(RecordingError, match="one phase factor in each channel"):
        open_recording(file, radar=radar, axes=axes).cube.load()


@pytest.mark.parametrize(
    ("shape", "options", "axes"),
    [
        ((5, 2, 4, 8), {}, "frame,rx,chirp,sample"),
        ((8, 4), {"n_rx": 1}, "sample,chirp"),
        ((5, 4, 2, 2, 8), {"order": (0, 1)}, "frame,chirp,tx,rx,sample"),
        ((8, 4), {"n_chirps": 1, "order": (0, 1)}, "sample,element"),
        ((4, 2, 8, 2), {}, "chirp,rx,sample,iq"),
        ((2, 4, 3, 8), {"n_rx": 3}, "iq,chirp,rx,sample"),
        ((7, 3, 9), {}, "chirp,rx,sample"),  # nothing fits: the usual order
    ],
)
def test_suggested_axes_have_the_sizes_of_the_radar(tmp_path, shape, options, axes):
    has_pairs = "iq" in axes
    np.save(tmp_path / "cube.npy", np.ones(shape, np.float32 if has_pairs else np.complex64) / 2)
    radar = make_radar(**options)

    with pytest.raises(RecordingError) as caught:
        open_recording(tmp_path / "cube.npy", radar=radar)

    assert f"--axes {axes} " in caught.value.mistakes[0].fix
    if shape != (7, 3, 9):
        assert open_recording(tmp_path / "cube.npy", radar=radar, axes=axes).n_frames in {1, 5}


def test_suggested_axes_of_text_with_two_columns_contain_i_and_q(tmp_path):
    np.savetxt(tmp_path / "beat.csv", np.random.default_rng(1).normal(size=(32, 2)), delimiter=";")
    radar = make_radar(n_rx=1)

    with pytest.raises(RecordingError) as caught:
        open_recording(tmp_path / "beat.csv", radar=radar)

    assert "--axes frame,chirp,sample,iq " in caught.value.mistakes[0].fix
    assert open_recording(tmp_path / "beat.csv", radar=radar, axes="frame,chirp,sample,iq")


def test_axis_of_all_antenna_pairs_named_rx_is_told_to_be_element(tmp_path):
    file = tmp_path / "pairs.npy"
    np.save(file, np.ones((6, 64), np.complex64) / 2)
    radar = make_radar(n_chirps=1, n_rx=3, n_samples=64, order=(0, 1))

    with pytest.raises(RecordingError, match="name the axis .* element instead of rx"):
        open_recording(file, radar=radar, axes="rx,sample")
    assert open_recording(file, radar=radar, axes="element,sample").cube.sizes["rx"] == 3


@pytest.mark.parametrize("kind", ["int16", "uint16", "float32", "float64"])
@pytest.mark.parametrize("is_complex", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_storage_types_decode_to_equal_numbers(tmp_path, kind, is_complex, compressed):
    numbers = np.random.default_rng(3).integers(0, 200, (4, 2, 8)).astype(kind)
    file = tmp_path / "cube.mat"
    if is_complex and kind.startswith("float"):
        numbers = (numbers + 1j * numbers[::-1]).astype(f"complex{2 * int(kind[5:])}")
    scipy.io.savemat(file, {"cube": numbers}, do_compression=compressed)

    radar = make_radar(sampling="complex" if np.iscomplexobj(numbers) else "real")
    options = {"axes": ("chirp", "rx", "sample"), "encoding": "full-scale"}
    assert np.array_equal(
        decode_frames(read_contents(file, "matlab", radar, **options))[0], numbers
    )


def encode_matlab_5(kinds, parts, order="<") -> bytes:
    """Encode a variable `x` of class double whose parts are stored in the given types."""

    def element(kind, data):
        return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)

    numbers = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "f8": 9}
    flags = struct.pack(f"{order}II", 6 | (0x0800 if len(parts) > 1 else 0), 0)
    sizes = struct.pack(f"{order}{parts[0].ndim}i", *parts[0].shape)
    name = struct.pack(f"{order}I", 1 << 16 | 1) + b"x\0\0\0"  # small element: data within its tag
    body = element(6, flags) + element(5, sizes) + name
    for kind, part in zip(kinds, parts, strict=True):
        body += element(numbers[kind], part.astype(order + kind).tobytes(order="F"))
    byte_order_mark = b"IM" if order == "<" else b"MI"
    header = b"MATLAB 5.0 MAT-file, by hand".ljust(124, b" ")
    return header + struct.pack(f"{order}H", 0x0100) + byte_order_mark + element(14, body)


@pytest.mark.parametrize("order", ["<", ">"])
def test_matlab_real_and_imaginary_part_may_differ_in_type(tmp_path, order):
    re, im = np.random.default_rng(4).integers(0, 100, (2, 4, 2, 8))
    (tmp_path / "cube.mat").write_bytes(encode_matlab_5(["i2", "u1"], [re, im], order))
    reference = scipy.io.loadmat(tmp_path / "cube.mat")["x"]
    assert np.array_equal(reference, re + 1j * im)

    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    cube = decode_frames(read_contents(tmp_path / "cube.mat", "matlab", **options))

    assert np.array_equal(cube[0] * 32768, re + 1j * im)


# --- Selection of the array -----------------------------------------------------------


def write_two_arrays(path) -> dict[str, Path]:
    """Write two possible cubes, A and B, to each container."""
    arrays = {"A": draw_samples(4, 2, 8, seed=5), "B": draw_samples(4, 2, 8, seed=6)}
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
def test_reads_named_array_of_several(tmp_path, kind):
    file = write_two_arrays(tmp_path)[kind]
    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}

    cube = decode_frames(read_contents(file, kind, inner_name="B", **options))
    unnamed = catch_mistake(file, kind, **options)
    misnamed = catch_mistake(file, kind, inner_name="C", **options)
    # Arrays of a Zarr folder are named by their subfolder.
    expected = "a readable file or folder" if kind == "zarr-array" else "array named C"

    assert np.array_equal(cube[0] * 32768, draw_samples(4, 2, 8, seed=6))
    assert "A (complex128 of 4 x 2 x 8), B (complex128 of 4 x 2 x 8)" in unnamed.value
    assert f"{file.name}/A" in unnamed.fix
    assert expected in misnamed.expected


def test_radar_settings_select_matching_array(tmp_path):
    samples = draw_samples(4, 2, 8)
    np.savez(tmp_path / "cube.npz", samples=samples, picture=np.zeros((64, 48)))

    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    assert np.array_equal(
        decode_frames(read_contents(tmp_path / "cube.npz", "npz", **options))[0] * 32768, samples
    )


def test_matlab_vectors_and_numbers_are_not_taken_for_cubes(tmp_path):
    # MATLAB saves a workspace: numbers and axes have two dimensions as well.
    samples = draw_samples(4, 2, 8)
    workspace = {"frequency": np.zeros((8, 1)), "data": samples, "time": np.zeros((1, 8))}
    scipy.io.savemat(tmp_path / "cube.mat", workspace | {"n_ramps": 4.0})

    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    cube = decode_frames(read_contents(tmp_path / "cube.mat", "matlab", **options))
    assert np.array_equal(cube[0] * 32768, samples)


def test_follows_hdf5_soft_link_within_file(tmp_path):
    samples = draw_samples(4, 2, 8)
    file = write_hdf5(tmp_path, samples)

    options = {"axes": ("chirp", "rx", "sample"), "encoding": "int16"}
    assert np.array_equal(
        decode_frames(read_contents(file, "hdf5", inner_name="link", **options))[0] * 32768, samples
    )


MEMORY_SCRIPT = """
import re, sys
from pathlib import Path
import numpy as np
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings.base import RecordingSettings
from test_generic_cubes import FORMATS, make_radar
hints = RecordingHints(
    settings=RecordingSettings(radar=make_radar(n_chirps=2048, n_rx=1, n_samples=64)),
    axes=("chirp", "sample", "frame"),
    encoding="full-scale",
)
def peak_mib():  # `resource` would include the peak of the parent process
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 2**10
base_mib = peak_mib()
out = np.ones((2048, 1, 64), np.complex64)
contents = FORMATS["npy"].read(Path(sys.argv[1]), hints)
contents.decode(400, out)
print(peak_mib() - base_mib, out.any())
"""


@nightly
@pytest.mark.skipif(
    sys.platform != "linux", reason="memory is measured with /proc, which only Linux has"
)
def test_strided_frames_are_read_in_bounded_memory(tmp_path):
    file, shape = tmp_path / "cube.npy", (2048, 64, 512)
    with file.open("wb") as output:  # sparse file of 512 MiB
        header = encode_npy_header(shape)
        output.write(header)
        output.truncate(len(header) + 8 * math.prod(shape))

    folders = (Path(dechirp.__file__).parents[1], *Path(__file__).parents[:2])
    paths = [str(folder) for folder in folders]
    process = subprocess.run(
        [sys.executable, "-c", MEMORY_SCRIPT, str(file)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=True,
    )

    added_mib, any_nonzero = process.stdout.split()
    assert float(added_mib) < 64  # three frames of 1 MiB, blocks of 16 MiB
    assert any_nonzero == "False"


# --- Text -----------------------------------------------------------------------------


def format_lines(numbers, separator, *, comma=False, end=""):
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
def test_text_columns_are_samples_of_one_chirp(tmp_path, separator, comma):
    numbers = np.random.default_rng(7).uniform(-1, 1, (12, 8))
    file = tmp_path / "cube.csv"
    file.write_text(format_lines(numbers, separator, comma=comma))
    radar = make_radar(n_rx=1, sampling="real")

    contents = read_contents(file, "text-columns", radar, axes=("frame", "chirp", "sample"))

    assert np.array_equal(decode_frames(contents)[:, :, 0], numbers.astype("f4").reshape(3, 4, 8))
    assert contents.findings == ()


def test_text_header_lines_are_skipped_with_finding(tmp_path):
    numbers = np.random.default_rng(8).uniform(-1, 1, (8, 2))  # sample, rx
    file = tmp_path / "scope.csv"
    file.write_bytes(
        b"\xef\xbb\xbfChannel 1;Channel 2\r\n(mV);(mV)\r\n\r\n"
        + format_lines(numbers, ";", comma=True, end=";").replace("\n", "\r\n").encode()
    )
    radar = make_radar(n_chirps=1, sampling="real")

    contents = read_contents(file, "text-columns", radar, axes=("sample", "rx"))

    assert np.array_equal(decode_frames(contents)[0, 0], numbers.T.astype("f4"))
    assert "2 lines before the first line of numbers" in contents.findings[0].value


@pytest.mark.parametrize("n_rx", [1, 2])
@pytest.mark.parametrize("is_right", [True, False])
def test_column_of_times_is_left_out(tmp_path, n_rx, is_right):
    # An oscilloscope, with times rounded to a fifth of their step.
    samples = np.random.default_rng(9).uniform(-1, 1, (4 * 8, n_rx))
    radar = make_radar(n_rx=n_rx, sampling="real")
    rate_hz = radar.frame.chirp.sample_rate_hz
    step_s = (1 if is_right else 2) / rate_hz
    times = np.round((step_s * np.arange(len(samples)) - 1e-3) * 5 * rate_hz) / (5 * rate_hz)
    rows = np.column_stack([times, samples])
    np.savetxt(tmp_path / "scope.csv", rows, delimiter=",", header="Time,Ampl", comments="")

    axes = ("chirp", "sample") if n_rx == 1 else ("chirp", "sample", "rx")
    contents = read_contents(tmp_path / "scope.csv", "text-columns", radar, axes=axes)

    expected = samples.reshape(4, 8, n_rx).transpose(0, 2, 1).astype("f4")
    assert np.array_equal(decode_frames(contents)[0], expected)
    _, left_out = contents.findings
    assert "left out as times" in left_out.value
    assert left_out.level == ("note" if is_right else "warning")
    if not is_right:
        assert f"those of {format_si(rate_hz / 2, 'hz')}" in left_out.value
        assert format_si(rate_hz, "hz") in left_out.expected


def test_columns_that_all_rise_are_samples(tmp_path):
    numbers = np.arange(4 * 8 * 8.0).reshape(32, 8)
    np.savetxt(tmp_path / "cube.txt", numbers)

    contents = read_contents(
        tmp_path / "cube.txt",
        "text-columns",
        make_radar(n_rx=1, sampling="real"),
        axes=("frame", "chirp", "sample"),
        encoding="full-scale",
    )

    assert np.array_equal(decode_frames(contents).reshape(32, 8), numbers)


def test_numbers_with_fractions_need_no_encoding(tmp_path):
    samples = 3 * draw_samples(8, 8) / 32768 * 40  # no ADC codes: they would be whole
    np.savetxt(tmp_path / "cube.txt", samples)
    options = {"axes": ("frame", "chirp", "sample")}

    cube = decode_frames(
        read_contents(tmp_path / "cube.txt", "text-columns", make_radar(n_rx=1), **options)
    )

    assert abs(samples).max() > 1
    assert np.array_equal(cube[:, :, 0], samples.reshape(2, 4, 8).astype(np.complex64))


def test_text_columns_of_i_and_q_are_complex_samples(tmp_path):
    samples = draw_samples(8, 8)
    numbers = np.stack([samples.real, samples.imag], axis=-1).reshape(8, 16)
    (tmp_path / "cube.txt").write_text(format_lines(numbers, " "))
    radar = make_radar(n_rx=1)

    options = {"axes": ("frame", "chirp", "sample", "iq"), "encoding": "int16"}
    cube = decode_frames(read_contents(tmp_path / "cube.txt", "text-columns", radar, **options))

    assert np.array_equal(cube[:, :, 0] * 32768, samples.reshape(2, 4, 8))


def savetxt_old(file, samples, **_):
    """Write as NumPy before version 1.14, with +- before negative imaginary parts."""
    rows = [" ".join(f"({z.real:.18e}+{z.imag:.18e}j)" for z in row) for row in samples]
    file.write_text("\n".join(rows) + "\n")


def savetxt_cpp(file, samples, **_):
    rows = [",".join(f"({z.real!r},{z.imag!r})" for z in row) for row in samples.tolist()]
    file.write_text("\n".join(rows) + "\n")


def savetxt_matlab(file, samples, **_):
    rows = [",".join(f"{z.real!r}{z.imag:+}i" for z in row) for row in samples.tolist()]
    file.write_text("\n".join(rows) + "\n")


COMPLEX_TEXTS = {
    "default": (np.savetxt, {}),
    "comma": (np.savetxt, {"delimiter": ","}),
    "comma and blank": (np.savetxt, {"delimiter": ", "}),
    "semicolon": (np.savetxt, {"delimiter": ";"}),
    "tab": (np.savetxt, {"delimiter": "\t"}),
    "one format": (np.savetxt, {"fmt": "%.17g"}),
    "signed": (np.savetxt, {"fmt": "\t".join(["%.17g%+.17gj"] * 8)}),
    "spaced": (np.savetxt, {"fmt": ";".join(["%.17g + %.17gi"] * 8)}),
    "header and footer": (np.savetxt, {"header": "radar\nsamples 8", "footer": "end 1"}),
    "windows": (np.savetxt, {"newline": "\r\n"}),
    "+-": (savetxt_old, {}),
    "C++": (savetxt_cpp, {}),
    "MATLAB": (savetxt_matlab, {}),
}


@pytest.mark.parametrize("suffix", [".txt", ".csv.gz"])
@pytest.mark.parametrize("form", nightly_except(5, COMPLEX_TEXTS))
def test_complex_text_gives_every_sample(tmp_path, form, suffix):
    save, options = COMPLEX_TEXTS[form]
    rng = np.random.default_rng(31)
    samples = 10.0 ** rng.uniform(-9, -1, (12, 8)) * np.exp(2j * np.pi * rng.random((12, 8)))
    samples[3, 4], samples[5, 0] = -1e-300j, 0.25
    if form == "spaced":  # %+ is the only form for negative parts there
        samples.imag = abs(samples.imag)
    file = tmp_path / f"cube{suffix}"
    save(tmp_path / "cube.txt", samples, **options)
    if suffix == ".csv.gz":
        # More frames than one: gzip is read on from the frame before, and from the start again.
        file.write_bytes(gzip.compress((tmp_path / "cube.txt").read_bytes()))

    assert recognise_formats(file) == ("text-columns",)
    options = {"axes": ("frame", "chirp", "sample"), "encoding": "full-scale"}
    contents = read_contents(file, "text-columns", make_radar(n_rx=1), **options)

    cube = decode_frames(contents)[:, :, 0].reshape(12, 8)
    assert np.array_equal(cube, samples.astype(np.complex64))
    again = np.empty((4, 1, 8), np.complex64)
    contents.decode(1, again)
    assert np.array_equal(again[:, 0], cube[4:8])


@pytest.mark.parametrize("n_bytes", [3, 9, 20, 200, -9, -1])
def test_truncated_compressed_text_is_refused(tmp_path, n_bytes):
    file = tmp_path / "cube.txt.gz"
    np.savetxt(file, draw_samples(400, 8) / 4096)
    file.write_bytes(file.read_bytes()[:n_bytes])

    with pytest.raises(RecordingError):
        decode_frames(
            read_contents(
                file, "text-columns", make_radar(n_rx=1), axes=("frame", "chirp", "sample")
            )
        )


def test_complex_text_with_a_word_names_its_line(tmp_path):
    np.savetxt(tmp_path / "cube.txt", draw_samples(8, 8) / 4096)
    text = (tmp_path / "cube.txt").read_text().replace("e-01j", "e-01k", 1)
    (tmp_path / "cube.txt").write_text("(1+1j) " * 7 + "(1-1j)\n" + text)

    with pytest.raises(RecordingError, match="something else than numbers"):
        decode_frames(
            read_contents(
                tmp_path / "cube.txt",
                "text-columns",
                make_radar(n_rx=1),
                axes=("frame", "chirp", "sample"),
                encoding="full-scale",
            )
        )


def test_truncated_text_drops_last_frame_with_warning(tmp_path):
    numbers = np.random.default_rng(9).uniform(-1, 1, (11, 8))
    (tmp_path / "cube.csv").write_text(format_lines(numbers, ","))
    radar = make_radar(n_rx=1, sampling="real")

    contents = read_contents(
        tmp_path / "cube.csv", "text-columns", radar, axes=("frame", "chirp", "sample")
    )

    assert (contents.n_frames, contents.findings[0].level) == (2, "warning")


def test_long_text_decodes_frame_in_middle(tmp_path):
    # Frame 73 lies beyond the line index (one entry per 64 lines), with blank lines between.
    numbers = np.random.default_rng(10).integers(-500, 500, (400, 8))
    rows = [
        " ".join(map(str, row)) + ("\n\n" if index % 7 == 0 else "\n")
        for index, row in enumerate(numbers)
    ]
    (tmp_path / "cube.txt").write_text("".join(rows))
    radar = make_radar(n_rx=1, sampling="real")

    options = {"axes": ("frame", "chirp", "sample"), "encoding": "int16"}
    contents = read_contents(tmp_path / "cube.txt", "text-columns", radar, **options)
    frame = np.empty((4, 1, 8), np.float32)
    contents.decode(73, frame)

    assert np.array_equal(frame[:, 0] * 32768, numbers[292:296])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3 4 5 6 7 8\n1 2 3\n", "line 2 is a row of 3 numbers instead of 8"),
        ("1 2 3 4 5 6 7 8\n" * 3 + "1 2 3 x 5 6 7 8\n", "something else than numbers"),
        ("1 2 3 4 5 6 7 8\n" * 3 + "1 2 3 1F5 5 6 7 8\n", "hexadecimal codes in one of"),
        ("a b\n" * 150, "not yet a line of numbers"),
        ("a b\n", "no line consists of numbers only"),
        ("1 2 3\n" * 32, "3 numbers in a line"),
        ("1 2 3 4 5 6 7 8\n" * 2, "2 lines of 8 numbers"),
    ],
)
def test_invalid_text_error_names_line(tmp_path, text, message):
    (tmp_path / "cube.txt").write_text(text)
    radar = make_radar(n_rx=1, sampling="real")
    hints = RecordingHints(
        settings=RecordingSettings(radar=radar), axes=("frame", "chirp", "sample"), encoding="int16"
    )

    with pytest.raises(RecordingError) as error:
        decode_frames(FORMATS["text-columns"].read(tmp_path / "cube.txt", hints))

    assert message in str(error.value)


def test_json_is_not_recognised_as_text_columns(tmp_path):
    (tmp_path / "said.json").write_text(json.dumps({"sizes": list(range(20))}, indent=1))

    assert FORMATS["text-columns"].recognise(tmp_path / "said.json") == MatchQuality.NO


# --- Native Zarr store ----------------------------------------------------------------


def write_run_folder(tmp_path, *, n_frames=2) -> tuple[Path, np.ndarray, Radar]:
    """Write a run folder with zarr only; return its path, samples and radar."""
    samples = draw_samples(n_frames, 8, 2, 8).astype(np.complex64)
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
    attributes = {"format_version": 1, "radar": text}
    store = zarr.create_group(tmp_path / "run" / "cube.zarr", attributes=attributes)
    store.create_array(
        "cube",
        shape=samples.shape,
        chunks=(1, *samples.shape[1:]),
        dtype=samples.dtype,
        dimension_names=AXES,
        attributes={"units": "W**0.5"},
    )[:] = samples
    return tmp_path / "run", samples, make_radar(order=(1, 0))


@pytest.mark.parametrize("inner_name", ["", "cube.zarr"])
def test_run_folder_is_recording_with_radar_and_units(tmp_path, inner_name):
    folder, samples, radar = write_run_folder(tmp_path)

    assert FORMATS["zarr"].recognise(folder / inner_name) == MatchQuality.SELF_DESCRIBING
    contents = FORMATS["zarr"].read(folder / inner_name, RecordingHints())

    assert np.array_equal(decode_frames(contents), samples)
    assert contents.units == "W**0.5"
    assert contents.radar == radar


def test_run_folder_with_scaled_integers_decodes_to_samples(tmp_path):
    folder, samples, _ = write_run_folder(tmp_path)
    group = zarr.open_group(folder / "cube.zarr")
    del group["cube"]
    parts = np.stack([samples.real, samples.imag], axis=-1).astype(np.int16)
    attributes = {"units": "1", "scale": 2**-15}
    group.create_array("cube", data=parts, dimension_names=(*AXES, "iq"), attributes=attributes)

    contents = FORMATS["zarr"].read(folder, RecordingHints())

    assert np.array_equal(decode_frames(contents) * 32768, samples)
    assert contents.units == "1"


@pytest.mark.parametrize("message", ["format version", "unreadable radar", "not readable"])
def test_rejects_invalid_run_folder(tmp_path, message):
    folder, _, _ = write_run_folder(tmp_path)
    metadata_file = folder / "cube.zarr" / "zarr.json"
    metadata = json.loads(metadata_file.read_text())
    if message == "format version":
        metadata["attributes"]["format_version"] = 2
    elif message == "not readable":
        (folder / "cube.zarr" / "cube" / "zarr.json").unlink()
    else:
        metadata["attributes"]["radar"]["frame"]["n_chirps"] = "many"
    metadata_file.write_text(json.dumps(metadata))

    with pytest.raises(RecordingError, match=message):
        FORMATS["zarr"].read(folder, RecordingHints())


def test_run_folder_opens_as_simulated_cube(tmp_path):
    folder, samples, radar = write_run_folder(tmp_path)

    recording = open_recording(folder)

    assert recording.format == "zarr"
    assert np.array_equal(recording.cube.values, samples)
    assert recording.cube.attrs["units"] == "W**0.5"
    assert recording.cube.transmitter.values.tolist() == [1, 0] * 4
    assert recording.radar == radar


# --- Bare numbers, and data sets ------------------------------------------------------


def encode_int16(samples) -> bytes:
    return np.stack([samples.real, samples.imag], axis=-1).astype("<i2").tobytes()


def test_bare_numbers_are_divided_into_frames_of_radar(tmp_path):
    samples = draw_samples(3, 2, 4, 8)  # frame, rx, chirp, sample
    (tmp_path / "cube.raw").write_bytes(encode_int16(samples) + b"\1\2\3\4")

    contents = read_contents(
        tmp_path / "cube.raw", "bare-cube", axes=("frame", "rx", "chirp", "sample", "iq")
    )

    assert np.array_equal(decode_frames(contents) * 32768, samples.swapaxes(1, 2))
    assert "2 numbers left out" in contents.findings[0].value


def test_rejects_bare_numbers_below_one_frame(tmp_path):
    (tmp_path / "cube.raw").write_bytes(bytes(100))

    mistake = catch_mistake(
        tmp_path / "cube.raw", "bare-cube", axes=("chirp", "rx", "sample", "iq")
    )

    assert "a file of 100 bytes" in mistake.value
    assert "128 numbers: 4 chirp x 2 rx x 8 sample x 2 iq" in mistake.expected


@pytest.mark.parametrize("encoding", ["int16", "uint16-wrapped", "offset-binary"])
def test_bare_numbers_decode_in_every_encoding(tmp_path, encoding):
    samples = draw_samples(4, 2, 8)
    content = encode_int16(samples)
    if encoding == "offset-binary":
        content = encode_int16(samples + 32768 * (1 + 1j))
    (tmp_path / "cube.raw").write_bytes(content)

    options = {"axes": ("chirp", "rx", "sample", "iq"), "encoding": encoding}
    assert np.array_equal(
        decode_frames(read_contents(tmp_path / "cube.raw", "bare-cube", **options))[0] * 32768,
        samples,
    )


def write_coloradar(path, by_tx):
    (path / "frame_0.bin").write_bytes(encode_int16(by_tx.transpose(1, 2, 0, 3)))
    return path / "frame_0.bin"


def write_raddet(path, by_tx):
    np.save(path / "000001.npy", by_tx.transpose(3, 0, 2, 1))
    return path / "000001.npy"


def write_radical(path, by_tx):
    with h5py.File(path / "scene.h5", "w") as file:
        file["radar"] = by_tx.reshape(1, len(by_tx), -1, by_tx.shape[-1])
        file["rgb"] = np.zeros((1, 8, 8, 3), np.uint8)
    return path / "scene.h5"


@pytest.mark.parametrize(
    "writer",
    [write_coloradar, write_raddet, write_radical],
    ids=lambda writer: writer.__name__.removeprefix("write_"),
)
def test_public_data_set_decodes_as_documented_with_warning(tmp_path, writer):
    by_tx = draw_samples(4, 3, 2, 8)  # chirp, tx, rx, sample
    kind, radar = writer.__name__.removeprefix("write_"), make_radar(order=(1, 0, 2))
    options = {} if kind == "coloradar" else {"encoding": "int16"}

    contents = read_contents(writer(tmp_path, by_tx), kind, radar, **options)

    cube = decode_frames(contents)
    for slot, transmitter in enumerate((1, 0, 2)):
        assert np.array_equal(cube[0, slot::3] * 32768, by_tx[:, transmitter])
    assert "never checked on a real file" in contents.findings[-1].value


def test_four_radial_chips_are_one_transmitter_with_16_receivers(tmp_path):
    samples = draw_samples(4, 16, 8)
    for chip in range(4):
        chip_samples = samples[:, 4 * chip : 4 * chip + 4]
        (tmp_path / f"adc{chip}.bin").write_bytes(encode_int16(chip_samples))
    radar = Radar(frame=make_radar().frame)

    for path in (tmp_path, tmp_path / "adc0.bin"):
        contents = read_contents(path, "radial", radar)
        assert np.array_equal(decode_frames(contents)[0] * 32768, samples)
        assert contents.radar.array.n_rx == 16
        assert "12 simultaneous transmitters" in contents.findings[-2].value
        assert "experimental" in contents.findings[-1].value


def test_readers_without_real_test_file_are_listed_as_experimental(capsys):
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


def test_formats_without_signature_must_be_named():
    kinds = {kind for kind, member in FORMATS.items() if member.must_be_named}

    assert {"bare-cube", "coloradar", "radial", "radical", "raddet"} <= kinds
    assert not kinds & {"npy", "npz", "matlab", "hdf5", "zarr-array", "text-columns", "zarr"}


# --- Missing data ---------------------------------------------------------------------


def test_unwritten_chunks_are_gaps_and_zero(tmp_path):
    samples = draw_samples(3, 4, 2, 8)
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        dataset = file.create_dataset("cube", samples.shape, "c8", chunks=(1, 2, 2, 8))
        dataset[:2] = samples[:2]
        dataset[2, :2] = samples[2, :2]
    group = zarr.create_array(
        tmp_path / "cube.zarr", shape=samples.shape, chunks=(1, 2, 1, 8), dtype="c8"
    )
    group[:] = samples
    for rx in range(2):
        (tmp_path / "cube.zarr" / "c" / "2" / "1" / str(rx) / "0").unlink()

    expected = samples.copy()
    expected[2, 2:] = 0
    for file, kind in ((tmp_path / "cube.h5", "hdf5"), (tmp_path / "cube.zarr", "zarr-array")):
        contents = read_contents(file, kind, axes=AXES, encoding="int16")
        assert np.array_equal(decode_frames(contents) * 32768, expected)
        assert np.argwhere(contents.gaps).tolist() == [[2, 2], [2, 3]]
        assert "2 of 12 chirps have gaps, the first in frame 2" in contents.findings[-1].value


def test_chirp_with_lost_chunk_is_gap_for_all_receivers(tmp_path):
    by_tx = draw_samples(4, 2, 2, 8)
    array = zarr.create_array(
        tmp_path / "cube.zarr", shape=by_tx.shape, chunks=(2, 1, 1, 8), dtype="c8"
    )
    array[:] = by_tx
    (tmp_path / "cube.zarr" / "c" / "1" / "0" / "1" / "0").unlink()  # chirps 2, 3 of tx 0, rx 1

    options = {"axes": ("chirp", "tx", "rx", "sample"), "encoding": "int16"}
    contents = read_contents(
        tmp_path / "cube.zarr", "zarr-array", make_radar(order=(0, 1)), **options
    )

    assert np.flatnonzero(contents.gaps[0]).tolist() == [4, 5, 6, 7]


# --- Invalid files --------------------------------------------------------------------


def fail_on_unpickling():
    pytest.fail("a pickle in a recording was opened")


class Trap:
    """Object that calls `fail_on_unpickling` when unpickled."""

    def __reduce__(self):
        return fail_on_unpickling, ()


def make_trap_array(*shape):
    objects = np.empty(shape, object)
    objects[:] = Trap()
    return objects


def test_never_unpickles_objects_in_archive(tmp_path):
    np.savez(tmp_path / "cube.npz", cube=make_trap_array(4, 2, 8))

    mistake = catch_mistake(tmp_path / "cube.npz", "npz", axes=("chirp", "rx", "sample"))

    assert "cube (object of 4 x 2 x 8)" in mistake.value


def test_never_uses_codec_that_unpickles(tmp_path):
    array = zarr.create_array(
        tmp_path / "cube.zarr", shape=(4, 2, 8), chunks=(4, 2, 8), dtype="c8", zarr_format=2
    )
    array[:] = 1
    metadata_file = tmp_path / "cube.zarr" / ".zarray"
    metadata = json.loads(metadata_file.read_text())
    metadata_file.write_text(json.dumps({**metadata, "filters": [{"id": "pickle"}]}))
    (tmp_path / "cube.zarr" / "0.0.0").write_bytes(pickle.dumps(Trap()))

    mistake = catch_mistake(tmp_path / "cube.zarr", "zarr-array", axes=("chirp", "rx", "sample"))

    assert "codec pickle" in mistake.value


def test_matlab_structure_is_named_with_its_fields(tmp_path):
    points = np.array([(1.0, 2.0)] * 3, [("range", "O"), ("azimuth", "O")])
    scipy.io.savemat(tmp_path / "cube.mat", {"history": points})

    for path in ("cube.mat", "cube.mat/history"):
        mistake = catch_mistake(tmp_path / path, "matlab")
        assert "history (structure of 1 x 3 with the fields range, azimuth)" in mistake.value
        assert "/cube" not in mistake.fix and "/history" not in mistake.fix


def test_rejects_matlab_cells_and_texts(tmp_path):
    cells = np.empty((4, 8), object)
    cells[:] = 1.0
    scipy.io.savemat(tmp_path / "cube.mat", {"cells": cells, "text": ["abcdefgh"] * 4})

    assert (
        "cells (cell array of 4 x 8), text (text"
        in catch_mistake(tmp_path / "cube.mat", "matlab", axes=("chirp", "sample")).value
    )


def test_never_reads_other_files_through_hdf5(tmp_path):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["cube"] = draw_samples(4, 2, 8)
    (tmp_path / "secret.raw").write_bytes(bytes(1024))
    layout = h5py.VirtualLayout((4, 2, 8), "c16")
    layout[:] = h5py.VirtualSource(str(secret), "cube", (4, 2, 8))
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file["linked"] = h5py.ExternalLink("secret.h5", "/cube")
        file["by way of"] = h5py.SoftLink("/linked")
        file["dangling"] = h5py.SoftLink("/nowhere")
        file["round"] = h5py.SoftLink("/round")
        file.create_virtual_dataset("virtual", layout)
        external_files = [(str(tmp_path / "secret.raw"), 0, 1024)]
        file.create_dataset("outside", (4, 2, 8), "c16", external=external_files)

    def find_mistake(name):
        options = {"axes": ("chirp", "rx", "sample"), "encoding": "full-scale"}
        return catch_mistake(tmp_path / "cube.h5", "hdf5", inner_name=name, **options).value

    assert "link to secret.h5" in find_mistake("linked")
    assert "link to secret.h5" in find_mistake("by way of")
    assert "virtual dataset" in find_mistake("virtual")
    assert "external storage" in find_mistake("outside")
    for name in ("dangling", "round", "linked/cube", "virtual/x"):
        assert "a file with" in find_mistake(name) or "link" in find_mistake(name)


def test_rejects_zarr_links_to_other_folders(tmp_path):
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

    options = {"axes": ("chirp", "rx", "sample")}
    assert (
        "c/0/0/0 is a link" in catch_mistake(tmp_path / "cube.zarr", "zarr-array", **options).value
    )
    assert "no array" in catch_mistake(group, "zarr-array", **options).value


def test_rejects_huge_shapes_before_allocation(tmp_path):
    huge_shape = (10**6, 4, 10**6, 8)
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        file.create_dataset("cube", huge_shape, "c8", chunks=(1, 4, 2, 8))
        large_shape = (26, 2**17, 1, 8)  # 208 MiB
        dataset = file.create_dataset(
            "piece", large_shape, "c8", chunks=large_shape, compression="gzip"
        )
        dataset.id.write_direct_chunk((0, 0, 0, 0), zlib.compress(bytes(208 * 2**20), 1))
    zarr.create_array(tmp_path / "cube.zarr", shape=huge_shape, chunks=(1, 4, 2, 8), dtype="c8")
    zarr.create_array(tmp_path / "piece.zarr", shape=huge_shape, chunks=huge_shape, dtype="c8")
    with zipfile.ZipFile(tmp_path / "cube.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("cube.npy", encode_npy_header(huge_shape) + bytes(512))
    scipy.io.savemat(tmp_path / "cube.mat", {"cube": np.zeros((4, 2, 8))})
    content = (tmp_path / "cube.mat").read_bytes()
    sizes = struct.pack("<3i", 4, 2, 8)
    assert sizes in content
    (tmp_path / "cube.mat").write_bytes(content.replace(sizes, struct.pack("<3i", 2**30, 2**30, 8)))

    options = {"axes": AXES}
    for name, kind in (("cube.h5", "hdf5"), ("cube.npz", "npz"), ("cube.zarr", "zarr-array")):
        inner_name = "cube" if kind == "hdf5" else None
        mistake = catch_mistake(tmp_path / name, kind, inner_name=inner_name, **options)
        assert "bytes" in mistake.value
    assert (
        "chunks" in catch_mistake(tmp_path / "cube.h5", "hdf5", inner_name="piece", **options).value
    )
    assert "bytes" in catch_mistake(tmp_path / "piece.zarr", "zarr-array", **options).value
    assert "1024" not in catch_mistake(tmp_path / "cube.mat", "matlab", axes=AXES[1:]).expected


def encode_npy_header(shape) -> bytes:
    text = f"{{'descr': '<c8', 'fortran_order': False, 'shape': {shape}}}\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def test_decompression_bomb_is_rejected_or_read_by_frame(tmp_path):
    file, shape = tmp_path / "cube.npz", (40, 2**17, 8)  # 320 MiB of zeros, in 0.3 MiB
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("cube.npy", "w") as member,
    ):
        member.write(encode_npy_header(shape))
        for _ in range(shape[0]):
            member.write(bytes(2**23))
    assert file.stat().st_size < 2**20

    radar_40_chirps, radar_131072_chirps = (
        make_radar(n_chirps=40, n_rx=1),
        make_radar(n_chirps=2**17, n_rx=1),
    )
    mistake = catch_mistake(file, "npz", radar_40_chirps, axes=("chirp", "frame", "sample"))
    contents = read_contents(file, "npz", radar_131072_chirps, axes=("frame", "chirp", "sample"))
    out = np.full((2**17, 1, 8), 1, np.complex64)
    contents.decode(7, out)

    assert "335544320 bytes to decompress" in mistake.value
    assert not out.any()


# --- Content that neither the first frame nor the header reveals ------------------------


def test_all_zero_first_frame_does_not_determine_encoding(tmp_path):
    numbers = np.zeros((2, 4, 2, 8))
    numbers[1] = 1234
    file = write_npy(tmp_path, numbers)

    mistake = catch_mistake(file, "npy", make_radar(sampling="real"), axes=AXES)

    assert "up to 1234 in frame 1 without an encoding" in mistake.value


@pytest.mark.parametrize(
    "storage_options", nightly_except(1, [{}, {"shuffle": True, "fletcher32": True}])
)
def test_rejects_hdf5_chunk_that_decompresses_beyond_its_size(tmp_path, storage_options):
    samples = draw_samples(3, 4, 2, 8)
    file = write_hdf5(tmp_path, samples, compression="gzip", chunks=(1, 4, 2, 8), **storage_options)
    options = {"axes": AXES, "encoding": "int16"}
    assert np.array_equal(decode_frames(read_contents(file, "hdf5", **options)) * 32768, samples)

    with h5py.File(file, "r+") as archive:  # 100 kB that decompress to 100 MB
        dataset = archive["scene/radar/samples"]
        dataset.id.write_direct_chunk((1, 0, 0, 0), zlib.compress(bytes(10**8)))

    assert "decompresses to more than" in catch_mistake(file, "hdf5", **options).value


@pytest.mark.parametrize("storage_options", [{}, {"shuffle": True, "fletcher32": True}])
@pytest.mark.parametrize("compression", ["lzf", "szip"])
def test_rejects_oversized_hdf5_chunk_of_other_compressions(tmp_path, compression, storage_options):
    samples = np.arange(192, dtype="<i2").reshape(3, 4, 2, 8) >> 2
    file = write_hdf5(
        tmp_path, samples, compression=compression, chunks=(1, 4, 2, 8), **storage_options
    )
    options = {"radar": make_radar(sampling="real"), "axes": AXES, "encoding": "int16"}
    assert np.array_equal(decode_frames(read_contents(file, "hdf5", **options)) * 32768, samples)

    if compression == "lzf":  # zero, then back-references of 264 bytes: 60 kB give 5 MB
        bomb = b"\0\0" + b"\xe0\xff\0" * 20_000
    else:  # declared size
        bomb = struct.pack("<I", 2**31) + bytes(100)
    with h5py.File(file, "r+") as archive:
        archive["scene/radar/samples"].id.write_direct_chunk((1, 0, 0, 0), bomb + bytes(4))

    assert "decompresses to more than" in catch_mistake(file, "hdf5", **options).value


def encode_zstd_zeros(n_bytes):
    """Encode zeros as a Zstandard stream of run-length blocks."""
    blocks = [struct.pack("<I", 2**17 << 3 | 2)[:3] + b"\0"] * (n_bytes >> 17)
    blocks[-1] = bytes([blocks[-1][0] | 1]) + blocks[-1][1:]
    return b"\x28\xb5\x2f\xfd\0\x58" + b"".join(blocks)


ZARR_2_COMPRESSORS = {  # codec, and encoder of a bomb of 50 MB
    "blosc": (numcodecs.Blosc("lz4"), numcodecs.Blosc("lz4").encode),
    "zstd": (numcodecs.Zstd(), numcodecs.Zstd().encode),
    "streamed zstd": (numcodecs.Zstd(), lambda zeros: encode_zstd_zeros(len(zeros))),
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


@pytest.mark.parametrize("filtered", nightly_except(1, [False, True]))
@pytest.mark.parametrize("compressor", nightly_except(3, ZARR_2_COMPRESSORS))
def test_rejects_zarr_chunk_that_decompresses_beyond_its_size(tmp_path, compressor, filtered):
    samples, options = draw_samples(3, 4, 2, 8), {"axes": AXES, "encoding": "int16"}
    codec, bomb = ZARR_2_COMPRESSORS[compressor]
    folder = tmp_path / "cube.zarr"
    array = zarr.create_array(
        folder,
        shape=samples.shape,
        chunks=(1, 4, 2, 8),
        dtype="c16",
        zarr_format=2,
        filters=[numcodecs.Delta("c16"), numcodecs.Shuffle(16)] if filtered else None,
        compressors=codec,
    )
    array[:] = samples
    assert np.array_equal(
        decode_frames(read_contents(folder, "zarr-array", **options)) * 32768, samples
    )

    (folder / "1.0.0.0").write_bytes(bomb(bytes(50_000_000)))

    assert "decompresses to more than 1024" in catch_mistake(folder, "zarr-array", **options).value


@pytest.mark.parametrize("checked", [False, True])
def test_reads_zarr_chunk_compressed_as_stream(tmp_path, checked):
    folder = tmp_path / "cube.zarr"
    compressors = [zarr.codecs.ZstdCodec(), *([zarr.codecs.Crc32cCodec()] if checked else [])]
    radar = make_radar(n_chirps=2**14, n_rx=1)
    array = zarr.create_array(  # 2**20 bytes
        folder, shape=(1, 2**14, 8), chunks=(1, 2**14, 8), dtype="c8", compressors=compressors
    )
    array[:] = 1
    content = encode_zstd_zeros(2**20)
    if checked:
        content += numcodecs.CRC32C(location="end").encode(content)[-4:].tobytes()
    (folder / "c" / "0" / "0" / "0").write_bytes(content)

    cube = decode_frames(
        read_contents(folder, "zarr-array", radar, axes=("frame", "chirp", "sample"))
    )

    assert not cube.any()


ZARR_3_COMPRESSORS = {
    "zstd": zarr.codecs.ZstdCodec(),
    "zstd with a checksum": zarr.codecs.ZstdCodec(checksum=True),
    "blosc": zarr.codecs.BloscCodec(),
    "gzip": zarr.codecs.GzipCodec(),
}


@pytest.mark.parametrize("checked", nightly_except([True], [False, True]))
@pytest.mark.parametrize("index_location", nightly_except(["end"], ["start", "end", None]))
@pytest.mark.parametrize("compressor", nightly_except(1, ZARR_3_COMPRESSORS))
def test_rejects_zarr_shard_piece_that_decompresses_beyond_its_size(
    tmp_path, compressor, index_location, checked
):
    samples, options = draw_samples(3, 4, 2, 8), {"axes": AXES, "encoding": "int16"}
    compressors = [
        ZARR_3_COMPRESSORS[compressor],
        *([zarr.codecs.Crc32cCodec()] if checked else []),
    ]
    inner = [zarr.codecs.BytesCodec(), *compressors]
    sharded = zarr.codecs.ShardingCodec(
        chunk_shape=(1, 2, 2, 8), codecs=inner, index_location=index_location or "end"
    )

    def write_cube(name, n_chirps):
        folder = tmp_path / name
        array = zarr.create_array(
            folder,
            shape=(3, n_chirps, 2, 8),
            chunks=(1, n_chirps, 2, 8),
            dtype="c16",
            serializer=sharded if index_location else zarr.codecs.BytesCodec(),
            compressors=None if index_location else compressors,
        )
        array[:] = samples if n_chirps == 4 else 1j
        return folder

    folder = write_cube("cube.zarr", 4)
    assert np.array_equal(
        decode_frames(read_contents(folder, "zarr-array", **options)) * 32768, samples
    )

    # Two pieces of 2 chirps each, replaced by pieces of 10**5 chirps.
    sharded = zarr.codecs.ShardingCodec(
        chunk_shape=(1, 10**5, 2, 8), codecs=inner, index_location=index_location or "end"
    )
    bomb = write_cube("bomb.zarr", 2 * 10**5) / "c" / "1" / "0" / "0" / "0"
    (folder / "c" / "1" / "0" / "0" / "0").write_bytes(bomb.read_bytes())

    assert "decompresses to more than" in catch_mistake(folder, "zarr-array", **options).value


def test_rejects_zarr_codecs_that_change_chunk_size(tmp_path):
    def find_mistake(name, **storage_options):
        zarr.create_array(
            tmp_path / name, shape=(4, 2, 8), chunks=(4, 2, 8), dtype="f4", **storage_options
        )[:] = 1
        radar = make_radar(sampling="real")
        return catch_mistake(
            tmp_path / name, "zarr-array", radar, axes=("chirp", "rx", "sample")
        ).value

    scaling = [numcodecs.FixedScaleOffset(offset=0, scale=10, dtype="f4", astype="i2")]
    compressors = [zarr.codecs.GzipCodec(), zarr.codecs.ZstdCodec()]
    nested = zarr.codecs.ShardingCodec(
        chunk_shape=(2, 2, 8), codecs=[zarr.codecs.ShardingCodec(chunk_shape=(1, 2, 8))]
    )

    assert "zstd after gzip" in find_mistake("a.zarr", compressors=compressors)
    assert "fixedscaleoffset" in find_mistake("b.zarr", zarr_format=2, filters=scaling)
    assert "sharding_indexed" in find_mistake("c.zarr", serializer=nested, compressors=None)
    assert "zlib" in find_mistake(
        "d.zarr", zarr_format=2, filters=[numcodecs.Zlib()], compressors=numcodecs.Zlib()
    )


def test_rejects_archive_of_million_members_before_listing(tmp_path):
    member = b"PK\1\2" + struct.pack("<6H3I5H2I", *[20, 20], *[0] * 7, 1, *[0] * 6) + b"a"
    listed = member * 10**6
    end = b"PK\5\6" + struct.pack("<4H2IH", 0, 0, 65535, 65535, len(listed), 30, 0)
    file = tmp_path / "cube.npz"
    file.write_bytes(b"PK\3\4" + bytes(26) + listed + end)

    assert "member list of 47000000 bytes" in catch_mistake(file, "npz", axes=AXES).value


def test_rejects_hdf5_dataset_compressed_twice(tmp_path):
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((4, 2, 8))
    for _ in range(2):
        properties.set_filter(h5py.h5z.FILTER_DEFLATE, 0, (9,))
    with h5py.File(tmp_path / "cube.h5", "w") as file:
        space, kind = h5py.h5s.create_simple((4, 2, 8)), h5py.h5t.py_create(np.dtype("c16"))
        dataset = h5py.h5d.create(file.id, b"samples", kind, space, properties)
        h5py.Dataset(dataset)[...] = 0.5

    mistake = catch_mistake(tmp_path / "cube.h5", "hdf5", axes=AXES[1:])

    assert "filters [1, 1]" in mistake.value


def test_rejects_named_pipe_as_zarr_chunk(tmp_path):
    folder = write_zarr(tmp_path, draw_samples(3, 4, 2, 8))
    chunk = folder / "samples" / "c" / "0" / "0" / "0" / "0"
    chunk.unlink()
    os.mkfifo(chunk)

    assert "neither a file nor a folder" in catch_mistake(folder, "zarr-array", axes=AXES).value


def test_interleaved_compressed_frames_give_finding_about_speed(tmp_path):
    radar = make_radar(n_chirps=64, n_rx=4, n_samples=64, sampling="real")
    frames_last = np.zeros((64, 4, 64, 1100), np.float32)  # 72 MB: more than the cache
    file = write_npz(tmp_path, frames_last, save=np.savez_compressed)
    options = {"axes": ("chirp", "rx", "sample", "frame")}

    (note,) = read_contents(file, "npz", radar, inner_name="samples", **options).findings

    assert "decompressed again for each of 1100 frames" in note.value


def test_rejects_bare_numbers_with_partial_last_number(tmp_path):
    numbers = np.zeros((4, 2, 8, 2), "<i2")
    (tmp_path / "cube.bin").write_bytes(numbers.tobytes() + b"x")

    mistake = catch_mistake(
        tmp_path / "cube.bin", "bare-cube", axes=("chirp", "rx", "sample", "iq")
    )

    assert mistake.value == "257 bytes"


def test_missing_receiver_count_gives_finding(tmp_path):
    (tmp_path / "cube.bin").write_bytes(np.zeros((3, 4, 2, 8, 2), "<i2").tobytes())
    radar_without_array = Radar(frame=make_radar().frame)

    contents = read_contents(
        tmp_path / "cube.bin", "bare-cube", radar_without_array, axes=(*AXES, "iq")
    )

    assert contents.n_frames == 6
    assert [finding.setting for finding in contents.findings] == ["radar.array.rx"]


def test_file_of_several_formats_needs_the_name_of_one(tmp_path, monkeypatch):
    np.save(tmp_path / "cube.npy", np.ones((4, 2, 8), np.complex64))
    monkeypatch.setattr(type(FORMATS["hdf5"]), "recognise", type(FORMATS["npy"]).recognise)

    with pytest.raises(RecordingError, match=r"of several formats: hdf5, npy.*--format hdf5"):
        open_recording(tmp_path / "cube.npy", radar=make_radar(), axes=AXES[1:])
    recording = open_recording(
        tmp_path / "cube.npy", radar=make_radar(), format="npy", axes=AXES[1:]
    )
    assert recording.format == "npy"
