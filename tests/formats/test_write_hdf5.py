"""Writer of HDF5 and netCDF: round trips, foreign readers, rejected tables and damaged files."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.radar.calibration import Calibration
from dechirp.radar.cube import label_cube
from dechirp.simulation.adc_codes import extract_adc_codes
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.quantisation import Quantisation
from formats.corruption import assert_cube_or_error, corrupted_bytes
from nightly import nightly, nightly_except

SCENE = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=10),
        dc.Target(name="Fußgänger", position_m=(9, -2, 0), rcs_m2=0.5),
    ]
)
EVERY_SUFFIX = pytest.mark.parametrize("suffix", [".h5", ".nc"])


@pytest.fixture(scope="module")
def small_radar(radar) -> dc.Radar:
    """Make a radar with 6 chirps of 32 samples and the hardware of the reference."""
    chirp = replace(radar.frame.chirp, n_samples=32)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=6, period_s=1e-3))


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def simulate_cube(radar, n_frames=3, bits=None):
    noise_w = ThermalNoise().noise_power_w(SCENE, radar)
    converter = [] if bits is None else [Quantisation(bits=bits, full_scale_w=1000 * noise_w)]
    return dc.simulate(SCENE, radar, impairments=[ThermalNoise(), *converter], n_frames=n_frames)


def write_and_open(path, cube, radar, **tables):
    dc.write(dc.recording_from_cube(cube, radar, tables=tables), path)
    return dc.open(path)


def assert_recording_equals(copy, cube, radar):
    """Compare samples bit by bit, axes and radar."""
    assert copy.format == "hdf5"
    assert copy.radar == radar
    assert copy.findings == ()
    assert copy.cube.values.tobytes() == cube.values.tobytes()
    xr.testing.assert_equal(copy.cube, cube)
    assert copy.cube.attrs["units"] == cube.attrs["units"]


@EVERY_SUFFIX
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_simulated_cube_round_trip_is_bit_exact(tmp_path, small_radar, sampling, suffix):
    radar = set_sampling(small_radar, sampling)
    cube = simulate_cube(radar)
    assert_recording_equals(write_and_open(tmp_path / f"cube{suffix}", cube, radar), cube, radar)


@EVERY_SUFFIX
def test_round_trip_keeps_tdm_calibration_and_intervals(tmp_path, small_radar, suffix):
    array = dc.Array(tx_m=[(0, 0, 0), (0, 8e-3, 0)], rx_m=[(0, 0, 0), (0, 2e-3, 0)])
    elements = ((1, 0), (0, 0), (0, 1), (1, 1))
    calibration = Calibration(
        elements=elements,
        gain=tuple((1.0, 0.1 * tx - 0.3 * rx) for tx, rx in elements),
        position_error_m=tuple((0.0, 1e-4 * index, 0.0) for index in range(4)),
        range_offset_m=0.07,
        residual=0.01,
    )
    frame = replace(
        small_radar.frame, multiplexing=dc.multiplexing.Tdm(order=(1, 0)), interval_s=(35e-6, 38e-6)
    )
    radar = replace(small_radar, frame=frame, array=array, calibration=calibration)
    cube = simulate_cube(radar)
    copy = write_and_open(tmp_path / f"cube{suffix}", cube, radar)
    assert_recording_equals(copy, cube, radar)
    assert {"transmitter", "chirp_time"} <= set(copy.cube.coords)


@EVERY_SUFFIX
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_quantised_samples_are_stored_as_codes(tmp_path, small_radar, sampling, suffix):
    radar = set_sampling(small_radar, sampling)
    cube = simulate_cube(radar, bits=12)
    copy = write_and_open(tmp_path / f"cube{suffix}", cube, radar)

    with h5py.File(tmp_path / f"cube{suffix}") as file:
        assert file["cube"].dtype == np.int16
        np.testing.assert_array_equal(file["cube"][()], extract_adc_codes(cube).values)
    assert_recording_equals(copy, cube + 0.0, radar)  # codes have no negative zero
    codes = extract_adc_codes(copy.cube)
    np.testing.assert_array_equal(codes.values, extract_adc_codes(cube).values)


def test_one_sample_off_code_grid_stores_floats(tmp_path, small_radar):
    cube = simulate_cube(small_radar, bits=12)
    cube.values[-1, 0, 0, 0] *= 1.1
    copy = write_and_open(tmp_path / "cube.h5", cube, small_radar)

    with h5py.File(tmp_path / "cube.h5") as file:
        assert file["cube"].dtype == np.complex64
    assert_recording_equals(copy, cube, small_radar)
    assert "scale" not in copy.cube.attrs


@EVERY_SUFFIX
def test_round_trip_keeps_tables(tmp_path, small_radar, suffix):
    cube = simulate_cube(small_radar)
    tables = {
        "truth": dc.truth(SCENE, small_radar, n_frames=3),
        "detections": dc.detect(cube, small_radar),
        "marks": xr.Dataset(
            {
                "gain": ("place", np.array([1 + 2j, 3], np.complex64), {"units": "1"}),
                "is_seen": ("place", np.array([True, False])),
                "word": (("place", "frame"), np.array([["", "ü"], ["b", "long"]])),
                "alone": ((), np.float32(0.5)),
            },
            attrs={"made": "by hand", "numbers": [1, 2]},
        ),
        "none": dc.detect(cube, small_radar).isel(detection=slice(0, 0)),
    }
    copy = write_and_open(tmp_path / f"cube{suffix}", cube, small_radar, **tables)

    assert set(copy.tables) == set(tables)
    for name, table in tables.items():
        xr.testing.assert_identical(copy.tables[name], table)
        for column in table.variables:
            assert copy.tables[name][column].dtype.kind == table[column].dtype.kind


@EVERY_SUFFIX
def test_selected_frames_are_written_as_recording(tmp_path, small_radar, suffix):
    radar = replace(small_radar, frame=replace(small_radar.frame, interval_s=(35e-6, 38e-6)))
    cube, truth = simulate_cube(radar, n_frames=4), dc.truth(SCENE, radar, n_frames=4)
    recording = dc.recording_from_cube(cube, radar, tables={"truth": truth})
    dc.write(recording.select_frames(1, 3), tmp_path / f"part{suffix}")

    copy = dc.open(tmp_path / f"part{suffix}")
    np.testing.assert_array_equal(copy.cube.values, cube.values[1:3])
    np.testing.assert_allclose(copy.cube.chirp_time, cube.chirp_time[1:3], rtol=1e-12)
    np.testing.assert_allclose(copy.cube.frame, cube.frame[1:3] - cube.frame[1], atol=1e-15)
    assert copy.tables["truth"].frame.values.tolist() == [0, 1]
    np.testing.assert_array_equal(copy.tables["truth"].range, truth.range[:, 1:3])
    # The delay from frame start to frame centre is unchanged.
    since_s = truth.time.values[1] - cube.frame.values[1]
    assert copy.tables["truth"].time.values[0] == pytest.approx(since_s, abs=1e-12)


@EVERY_SUFFIX
def test_round_trip_keeps_gaps(tmp_path, small_radar, suffix):
    gap = np.zeros((3, 6), bool)
    gap[1, 2:4] = True
    cube = simulate_cube(small_radar).assign_coords(gap=(("frame", "chirp"), gap))
    cube.values[gap] = 0
    copy = write_and_open(tmp_path / f"cube{suffix}", cube, small_radar)
    assert_recording_equals(copy, cube, small_radar)
    assert copy.cube.gap.dtype == bool


@EVERY_SUFFIX
def test_given_radar_takes_precedence_over_file(tmp_path, small_radar, suffix):
    path = tmp_path / f"cube{suffix}"
    write_and_open(path, simulate_cube(small_radar), small_radar)
    shifted_radar = replace(small_radar, array=dc.Array(rx_m=[(0, 0, 0), (0, 2.1e-3, 0)]))
    assert dc.open(path, radar=shifted_radar).radar == shifted_radar


def test_named_array_is_read_as_foreign_file(tmp_path, small_radar):
    cube = simulate_cube(small_radar)
    write_and_open(tmp_path / "cube.h5", cube, small_radar)
    options = {"axes": "frame,chirp,rx,sample", "encoding": "full-scale", "radar": small_radar}
    copy = dc.open(tmp_path / "cube.h5" / "cube", **options)
    assert copy.cube.attrs["units"] == "1"
    np.testing.assert_array_equal(copy.cube.values, cube.values)


def test_file_can_be_overwritten_while_it_is_read(tmp_path, small_radar):
    cube = simulate_cube(small_radar)
    copy = write_and_open(tmp_path / "cube.h5", cube, small_radar)
    dc.write(copy.select_frames(1, 3), tmp_path / "cube.h5")
    np.testing.assert_array_equal(dc.open(tmp_path / "cube.h5").cube.values, cube.values[1:])


# --- Other programs -------------------------------------------------------------------


@pytest.mark.parametrize("engine", nightly_except(1, ["h5netcdf", "netcdf4"]))
@pytest.mark.parametrize("bits", [None, 16])
def test_netcdf_libraries_read_equal_labelled_samples(tmp_path, small_radar, engine, bits):
    pytest.importorskip({"netcdf4": "netCDF4"}.get(engine, engine))
    cube = simulate_cube(small_radar, bits=bits)
    gap = np.zeros((3, 6), bool)
    gap[2, 1] = True
    cube = cube.assign_coords(gap=(("frame", "chirp"), gap))
    write_and_open(
        tmp_path / "cube.nc", cube, small_radar, truth=dc.truth(SCENE, small_radar, n_frames=3)
    )

    with xr.open_dataset(tmp_path / "cube.nc", engine=engine) as dataset:
        assert dataset["cube"].dtype == np.float32
        assert dataset["cube"].dims == ("frame", "chirp", "rx", "sample", "iq")
        parts = dataset["cube"].values
        for name in ("frame", "chirp", "rx", "sample"):
            np.testing.assert_array_equal(dataset[name], cube[name])
            assert dataset[name].attrs["units"] == cube[name].attrs["units"]
        assert dataset.coords["iq"].attrs["flag_meanings"] == "real imaginary"
        np.testing.assert_array_equal(dataset.coords["gap"], gap)
        assert dataset["cube"].attrs["units"] == "W**0.5"
    np.testing.assert_array_equal(parts[..., 0], cube.values.real)
    np.testing.assert_array_equal(parts[..., 1], cube.values.imag)
    with xr.open_dataset(tmp_path / "cube.nc", engine=engine, group="truth") as dataset:
        names = [
            target_name.decode() if isinstance(target_name, bytes) else target_name
            for target_name in dataset.target.values
        ]
        assert names == ["car", "Fußgänger"]
        assert dataset.range.dims == ("target", "frame")


def test_netcdf_file_holds_full_16_bit_code_range(tmp_path, small_radar):
    library = pytest.importorskip("netCDF4")
    step = np.float32(2.0**-20)
    cube = simulate_cube(small_radar)
    numbers = np.random.default_rng(3).integers(-32768, 32768, (*cube.shape, 2)).astype(np.int16)
    numbers[0, 0, 0, :2] = [[-32767, -32768], [32767, 0]]
    cube = cube.copy(data=(numbers * step).view(np.complex64)[..., 0]).assign_attrs(scale=step)
    write_and_open(tmp_path / "cube.nc", cube, small_radar)

    with library.Dataset(tmp_path / "cube.nc") as file:
        file.set_auto_mask(False)  # netCDF4 would mask -32767 as its fill value
        np.testing.assert_array_equal(file["cube"][:], (numbers * step))
    with xr.open_dataset(tmp_path / "cube.nc", engine="netcdf4") as dataset:
        np.testing.assert_array_equal(dataset["cube"], numbers * step)


# --- Rejected content -----------------------------------------------------------------


@EVERY_SUFFIX
@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        ("cube", xr.Dataset(), "table named 'cube'"),
        ("a/b", xr.Dataset(), "table named 'a/b'"),
        (".", xr.Dataset(), "without a slash"),
        ("t", xr.Dataset({"v/w": ("n", [1.0])}), "column or an axis named 'v/w'"),
        ("t", xr.Dataset({"v": ("n/m", [1.0])}), "column or an axis named 'n/m'"),
        ("t", xr.Dataset({"v": ("n", np.zeros(1, np.float16))}), "a column v of float16"),
        ("t", xr.Dataset({"v": ("n", np.zeros(1, "M8[ns]"))}), "datetime64"),
        ("t", xr.Dataset({"n": ("m", [1]), "v": ("n", [1, 2])}), "a column n over m"),
        ("t", xr.Dataset(attrs={"a": np.zeros(2)}), "attributes"),
    ],
)
def test_rejects_tables_without_netcdf_form(tmp_path, small_radar, name, table, message, suffix):
    with pytest.raises(DechirpError, match=message):
        recording = dc.recording_from_cube(
            simulate_cube(small_radar), small_radar, tables={name: table}
        )
        dc.write(recording, tmp_path / f"cube{suffix}")
    assert not list(tmp_path.iterdir())


def test_rejects_non_finite_samples_and_leaves_no_file(tmp_path, small_radar):
    cube = simulate_cube(small_radar)
    cube.values[1, 2, 0, 3] = np.nan
    with pytest.raises(DechirpError, match="non-finite samples in frame 1"):
        write_and_open(tmp_path / "cube.h5", cube, small_radar)
    assert not list(tmp_path.iterdir())


def test_rejects_detections_without_samples(tmp_path, small_radar):
    recording = dc.recording_from_cube(simulate_cube(small_radar), small_radar)
    recording = replace(recording, contents=replace(recording.contents, decode=None))
    with pytest.raises(RecordingError, match="contains detections without samples"):
        dc.write(recording, tmp_path / "cube.nc")


_LIMITED_WRITE_SCRIPT = """
import resource, sys
import dechirp as dc
opened, least = dc.open(sys.argv[1]), int(sys.argv[2])
for room in range(0, least * 9 // 10, least // 12):
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, resource.RLIM_INFINITY))
    try:
        dc.write(opened, sys.argv[1])
    except dc.DechirpError as error:
        assert "not writable" in str(error), error
    else:
        sys.exit(f"{room} bytes were enough")
"""


@nightly
@EVERY_SUFFIX
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of file sizes")
def test_full_disk_keeps_existing_file(tmp_path, small_radar, suffix):
    path = tmp_path / f"cube{suffix}"
    write_and_open(
        path,
        simulate_cube(small_radar),
        small_radar,
        truth=dc.truth(SCENE, small_radar, n_frames=3),
    )
    content = path.read_bytes()
    # A separate process, because HDF5 may crash after a failed write.
    command = [sys.executable, "-c", _LIMITED_WRITE_SCRIPT, str(path), str(len(content))]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (process.returncode, process.stderr) == (0, "")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == content


def test_frames_are_read_and_written_alternately(tmp_path, small_radar):
    cube, steps = simulate_cube(small_radar), []
    source = dc.recording_from_cube(cube, small_radar)

    def decode(number, out):
        steps.append(number)
        out[:] = cube.values[number]

    source = replace(source, contents=replace(source.contents, decode=decode))
    dc.write(source, tmp_path / "cube.h5", progress=lambda *counts: steps.append(counts))
    assert steps == [0, (1, 3), 1, (2, 3), 2, (3, 3)]


def test_read_error_keeps_existing_file(tmp_path, small_radar):
    write_and_open(tmp_path / "cube.h5", simulate_cube(small_radar), small_radar)
    content = (tmp_path / "cube.h5").read_bytes()
    source = dc.recording_from_cube(simulate_cube(small_radar), small_radar)

    def fail_at_frame_1(number, out):
        if number == 1:
            raise OSError(28, "No space left on device")
        out[:] = 0

    source = replace(source, contents=replace(source.contents, decode=fail_at_frame_1))
    with pytest.raises(DechirpError, match="No space left"):
        dc.write(source, tmp_path / "cube.h5")
    assert [file.name for file in tmp_path.iterdir()] == ["cube.h5"]
    assert (tmp_path / "cube.h5").read_bytes() == content


# --- Damaged files --------------------------------------------------------------------


def change_file(path, change):
    with h5py.File(path, "r+") as file:
        change(file)


def replace_text(old, new):
    def change(file):
        text = file.attrs["dechirp"].decode()
        assert old in text
        file.attrs["dechirp"] = np.bytes_(text.replace(old, new))

    return change


def replace_dataset(name, **options):
    def change(file):
        del file[name]
        file.create_dataset(name, **options)

    return change


def replace_with_link(name, target):
    def change(file):
        del file[name]
        file[name] = target

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (replace_text('"dechirp_exchange": 1', '"dechirp_exchange": 7'), "version 7"),
        (replace_text("W**0.5", "volt"), "volt"),
        (replace_text("n_samples", "n_sampels"), "unreadable radar"),
        (replace_text('"target"', '"tar"'), "truth"),
        (replace_text('"scale": null', '"scale": 0.5'), "scale of 0.5"),
        (lambda file: file.pop("cube"), "cube"),
        (lambda file: file.pop("truth"), "truth"),
        (replace_with_link("cube", h5py.ExternalLink("other.h5", "cube")), "a link to other.h5"),
        (replace_dataset("cube", shape=(3, 6, 2, 32), dtype=np.complex64), "never written"),
        (replace_dataset("truth/range", shape=(2**40,), dtype="f8", chunks=(2**10,)), "bytes"),
        (replace_dataset("truth/range", data=["a", "b"]), "truth"),
        (replace_dataset("gap", data=np.zeros((3, 5), np.uint8)), "gap of 3 x 5"),
    ],
)
def test_altered_native_file_error_names_mistake(tmp_path, small_radar, change, message):
    path = tmp_path / "cube.h5"
    cube = simulate_cube(small_radar).assign_coords(
        gap=(("frame", "chirp"), np.zeros((3, 6), bool))
    )
    write_and_open(path, cube, small_radar, truth=dc.truth(SCENE, small_radar, n_frames=3))
    change_file(path, change)
    with pytest.raises(RecordingError, match=message):
        dc.open(path)


@nightly
def test_round_trip_keeps_calibration_of_900_channels(tmp_path, small_radar):
    # The description exceeds 64 KiB, the attribute limit of the oldest HDF5 files.
    array = dc.Array(rx_m=[(0, 2e-3 * index, 0) for index in range(900)])
    gain = np.random.default_rng(2).normal(size=(900, 2))
    calibration = Calibration(elements=tuple((0, rx) for rx in range(900)), gain=gain)
    radar = replace(small_radar, array=array, calibration=calibration)
    frame = replace(radar.frame, chirp=replace(radar.frame.chirp, n_samples=4), n_chirps=2)
    radar = replace(radar, frame=frame)
    samples = np.ones((1, 2, 900, 4), np.complex64)
    cube = label_cube(samples, radar, units="1")
    copy = write_and_open(tmp_path / "cube.nc", cube, radar)
    with h5py.File(tmp_path / "cube.nc") as file:
        assert len(file.attrs["dechirp"]) > 2**16
    assert_recording_equals(copy, cube, radar)


def test_variable_length_description_is_ignored(tmp_path, small_radar):
    # HDF5 does not terminate when it reads a damaged variable-length text.
    path = tmp_path / "cube.h5"
    write_and_open(path, simulate_cube(small_radar), small_radar)
    change_file(path, lambda file: file.attrs.create("dechirp", file.attrs["dechirp"].decode()))
    with pytest.raises(RecordingError, match="axes"):
        dc.open(path, radar=small_radar)


def test_invalid_description_makes_file_foreign(tmp_path, small_radar):
    path = tmp_path / "cube.h5"
    write_and_open(path, simulate_cube(small_radar), small_radar)
    change_file(path, lambda file: file.attrs.create("dechirp", b"{"))
    with pytest.raises(RecordingError, match="axes"):
        dc.open(path, radar=small_radar)


@nightly
@settings(max_examples=60)
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, small_radar, data):
    path = tmp_path_factory.mktemp("damaged") / "cube.h5"
    cube = simulate_cube(small_radar, n_frames=1, bits=8)
    write_and_open(path, cube, small_radar, truth=dc.truth(SCENE, small_radar))
    path.write_bytes(data.draw(corrupted_bytes(path.read_bytes())))
    assert_cube_or_error(path)


# --- Real recordings ------------------------------------------------------------------


@EVERY_SUFFIX
@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
@pytest.mark.parametrize(
    "name",
    nightly_except(
        1, ["awr1642_vibrating_pipe/vibration_2.bin", "bgt60_people_room/RadarIfxAvian_00"]
    ),
)
def test_real_recording_round_trip_is_exact(tmp_path, name, suffix):
    recording = dc.open(Path(os.environ["DECHIRP_REAL_DATA"]) / name)
    recording = recording.select_frames(0, min(recording.n_frames, 20))
    dc.write(recording, tmp_path / f"cube{suffix}")
    copy = dc.open(tmp_path / f"cube{suffix}")
    assert copy.radar == recording.radar
    for original_frame, copied_frame in zip(recording.frames(), copy.frames(), strict=True):
        xr.testing.assert_identical(copied_frame, original_frame)
