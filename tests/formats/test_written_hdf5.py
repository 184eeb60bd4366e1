"""Recordings written as HDF5 and netCDF come back equal, and open in other programs."""

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
from dechirp.simulation.impairments.quantisation import Quantisation
from dechirp.simulation.impairments.thermal_noise import ThermalNoise
from formats.any_bytes import damaged, gives_a_cube_or_says_why

SCENE = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=10),
        dc.Target(name="Fußgänger", position_m=(9, -2, 0), rcs_m2=0.5),
    ]
)
BOTH = pytest.mark.parametrize("ending", [".h5", ".nc"])


@pytest.fixture(scope="module")
def small(radar) -> dc.Radar:
    """Few chirps of few samples, with the hardware of the reference."""
    chirp = replace(radar.frame.chirp, n_samples=32)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=6, period_s=1e-3))


def as_sampled(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def simulated(radar, n_frames=3, bits=None):
    noise_w = ThermalNoise().noise_power_w(SCENE, radar)
    converter = [] if bits is None else [Quantisation(bits=bits, full_scale_w=1000 * noise_w)]
    return dc.simulate(SCENE, radar, impairments=[ThermalNoise(), *converter], n_frames=n_frames)


def written(path, cube, radar, **tables):
    dc.write(dc.recording_from_cube(cube, radar, tables=tables), path)
    return dc.open(path)


def must_be_equal(opened, cube, radar):
    """Same bits, same axes, same radar."""
    assert opened.format == "hdf5"
    assert opened.radar == radar
    assert opened.findings == ()
    assert opened.cube.values.tobytes() == cube.values.tobytes()
    xr.testing.assert_equal(opened.cube, cube)
    assert opened.cube.attrs["units"] == cube.attrs["units"]


@BOTH
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_simulated_cube_comes_back_bit_by_bit_with_its_radar(tmp_path, small, sampling, ending):
    radar = as_sampled(small, sampling)
    cube = simulated(radar)
    must_be_equal(written(tmp_path / f"cube{ending}", cube, radar), cube, radar)


@BOTH
def test_transmitters_in_turns_their_calibration_and_intervals_come_back(tmp_path, small, ending):
    array = dc.Array(tx_m=[(0, 0, 0), (0, 8e-3, 0)], rx_m=[(0, 0, 0), (0, 2e-3, 0)])
    elements = ((1, 0), (0, 0), (0, 1), (1, 1))
    calibration = Calibration(
        elements=elements,
        gain=tuple((1.0, 0.1 * tx - 0.3 * rx) for tx, rx in elements),
        position_error_m=tuple((0.0, 1e-4 * place, 0.0) for place in range(4)),
        range_offset_m=0.07,
        residual=0.01,
    )
    frame = replace(
        small.frame, multiplexing=dc.multiplexing.Tdm(order=(1, 0)), interval_s=(35e-6, 38e-6)
    )
    radar = replace(small, frame=frame, array=array, calibration=calibration)
    cube = simulated(radar)
    opened = written(tmp_path / f"cube{ending}", cube, radar)
    must_be_equal(opened, cube, radar)
    assert {"transmitter", "chirp_time"} <= set(opened.cube.coords)


@BOTH
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_what_a_converter_rounded_is_kept_as_its_codes(tmp_path, small, sampling, ending):
    radar = as_sampled(small, sampling)
    cube = simulated(radar, bits=12)
    opened = written(tmp_path / f"cube{ending}", cube, radar)

    with h5py.File(tmp_path / f"cube{ending}") as file:
        assert file["cube"].dtype == np.int16
        np.testing.assert_array_equal(file["cube"][()], extract_adc_codes(cube).values)
    must_be_equal(opened, cube + 0.0, radar)  # a code has no negative zero
    again = extract_adc_codes(opened.cube)
    np.testing.assert_array_equal(again.values, extract_adc_codes(cube).values)


def test_one_sample_that_is_no_code_in_the_last_frame_makes_all_of_them_floats(tmp_path, small):
    cube = simulated(small, bits=12)
    cube.values[-1, 0, 0, 0] *= 1.1
    opened = written(tmp_path / "cube.h5", cube, small)

    with h5py.File(tmp_path / "cube.h5") as file:
        assert file["cube"].dtype == np.complex64
    must_be_equal(opened, cube, small)
    assert "scale" not in opened.cube.attrs


@BOTH
def test_truth_and_detections_travel_along(tmp_path, small, ending):
    cube = simulated(small)
    tables = {
        "truth": dc.truth(SCENE, small, n_frames=3),
        "detections": dc.detect(cube, small),
        "marks": xr.Dataset(
            {
                "gain": ("place", np.array([1 + 2j, 3], np.complex64), {"units": "1"}),
                "is_seen": ("place", np.array([True, False])),
                "word": (("place", "frame"), np.array([["", "ü"], ["b", "long"]])),
                "alone": ((), np.float32(0.5)),
            },
            attrs={"made": "by hand", "numbers": [1, 2]},
        ),
        "none": dc.detect(cube, small).isel(detection=slice(0, 0)),
    }
    opened = written(tmp_path / f"cube{ending}", cube, small, **tables)

    assert set(opened.tables) == set(tables)
    for name, table in tables.items():
        xr.testing.assert_identical(opened.tables[name], table)
        for column in table.variables:
            assert opened.tables[name][column].dtype.kind == table[column].dtype.kind


@BOTH
def test_a_part_is_written_as_a_recording_of_its_own(tmp_path, small, ending):
    radar = replace(small, frame=replace(small.frame, interval_s=(35e-6, 38e-6)))
    cube, truth = simulated(radar, n_frames=4), dc.truth(SCENE, radar, n_frames=4)
    whole = dc.recording_from_cube(cube, radar, tables={"truth": truth})
    dc.write(whole.select_frames(1, 3), tmp_path / f"part{ending}")

    opened = dc.open(tmp_path / f"part{ending}")
    np.testing.assert_array_equal(opened.cube.values, cube.values[1:3])
    np.testing.assert_allclose(opened.cube.chirp_time, cube.chirp_time[1:3], rtol=1e-12)
    np.testing.assert_allclose(opened.cube.frame, cube.frame[1:3] - cube.frame[1], atol=1e-15)
    assert opened.tables["truth"].frame.values.tolist() == [0, 1]
    np.testing.assert_array_equal(opened.tables["truth"].range, truth.range[:, 1:3])
    # The first middle of a frame comes as late after its start as it did.
    since_s = truth.time.values[1] - cube.frame.values[1]
    assert opened.tables["truth"].time.values[0] == pytest.approx(since_s, abs=1e-12)


@BOTH
def test_chirps_that_were_lost_are_still_marked(tmp_path, small, ending):
    gap = np.zeros((3, 6), bool)
    gap[1, 2:4] = True
    cube = simulated(small).assign_coords(gap=(("frame", "chirp"), gap))
    cube.values[gap] = 0
    opened = written(tmp_path / f"cube{ending}", cube, small)
    must_be_equal(opened, cube, small)
    assert opened.cube.gap.dtype == bool


@BOTH
def test_the_radar_that_the_user_gives_comes_first(tmp_path, small, ending):
    path = tmp_path / f"cube{ending}"
    written(path, simulated(small), small)
    shifted = replace(small, array=dc.Array(rx_m=[(0, 0, 0), (0, 2.1e-3, 0)]))
    assert dc.open(path, radar=shifted).radar == shifted


def test_a_named_array_is_read_as_of_any_hdf5_file(tmp_path, small):
    cube = simulated(small)
    written(tmp_path / "cube.h5", cube, small)
    told = {"axes": "frame,chirp,rx,sample", "encoding": "full-scale", "radar": small}
    opened = dc.open(tmp_path / "cube.h5" / "cube", **told)
    assert opened.cube.attrs["units"] == "full scale"
    np.testing.assert_array_equal(opened.cube.values, cube.values)


def test_a_file_can_be_written_over_the_one_it_is_read_from(tmp_path, small):
    cube = simulated(small)
    opened = written(tmp_path / "cube.h5", cube, small)
    dc.write(opened.select_frames(1, 3), tmp_path / "cube.h5")
    np.testing.assert_array_equal(dc.open(tmp_path / "cube.h5").cube.values, cube.values[1:])


# --- Other programs -------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
@pytest.mark.parametrize("bits", [None, 16])
def test_other_readers_of_netcdf_see_equal_samples_on_labelled_axes(tmp_path, small, engine, bits):
    pytest.importorskip({"netcdf4": "netCDF4"}.get(engine, engine))
    cube = simulated(small, bits=bits)
    gap = np.zeros((3, 6), bool)
    gap[2, 1] = True
    cube = cube.assign_coords(gap=(("frame", "chirp"), gap))
    written(tmp_path / "cube.nc", cube, small, truth=dc.truth(SCENE, small, n_frames=3))

    with xr.open_dataset(tmp_path / "cube.nc", engine=engine) as seen:
        assert seen["cube"].dtype == np.float32
        assert seen["cube"].dims == ("frame", "chirp", "rx", "sample", "iq")
        parts = seen["cube"].values
        for name in ("frame", "chirp", "rx", "sample"):
            np.testing.assert_array_equal(seen[name], cube[name])
            assert seen[name].attrs["units"] == cube[name].attrs["units"]
        assert seen.coords["iq"].attrs["flag_meanings"] == "real imaginary"
        np.testing.assert_array_equal(seen.coords["gap"], gap)
        assert seen["cube"].attrs["units"] == "sqrt(W)"
    np.testing.assert_array_equal(parts[..., 0], cube.values.real)
    np.testing.assert_array_equal(parts[..., 1], cube.values.imag)
    with xr.open_dataset(tmp_path / "cube.nc", engine=engine, group="truth") as seen:
        names = [one.decode() if isinstance(one, bytes) else one for one in seen.target.values]
        assert names == ["car", "Fußgänger"]
        assert seen.range.dims == ("target", "frame")


def test_all_codes_of_16_bits_are_in_the_netcdf_file(tmp_path, small):
    library = pytest.importorskip("netCDF4")
    step = np.float32(2.0**-20)
    cube = simulated(small)
    numbers = np.random.default_rng(3).integers(-32768, 32768, (*cube.shape, 2)).astype(np.int16)
    numbers[0, 0, 0, :2] = [[-32767, -32768], [32767, 0]]
    cube = cube.copy(data=(numbers * step).view(np.complex64)[..., 0]).assign_attrs(scale=step)
    written(tmp_path / "cube.nc", cube, small)

    with library.Dataset(tmp_path / "cube.nc") as file:
        file.set_auto_mask(False)  # it takes -32767 for what was never written
        np.testing.assert_array_equal(file["cube"][:], (numbers * step))
    with xr.open_dataset(tmp_path / "cube.nc", engine="netcdf4") as seen:
        np.testing.assert_array_equal(seen["cube"], numbers * step)


# --- What cannot be written -----------------------------------------------------------


@BOTH
@pytest.mark.parametrize(
    ("name", "table", "said"),
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
def test_tables_that_no_netcdf_file_holds_are_refused_in_words(
    tmp_path, small, name, table, said, ending
):
    with pytest.raises(DechirpError, match=said):
        made = dc.recording_from_cube(simulated(small), small, tables={name: table})
        dc.write(made, tmp_path / f"cube{ending}")
    assert not list(tmp_path.iterdir())


def test_samples_that_are_not_finite_are_refused_and_nothing_is_left(tmp_path, small):
    cube = simulated(small)
    cube.values[1, 2, 0, 3] = np.nan
    with pytest.raises(DechirpError, match="non-finite samples in frame 1"):
        written(tmp_path / "cube.h5", cube, small)
    assert not list(tmp_path.iterdir())


def test_detections_alone_are_no_recording_of_samples(tmp_path, small):
    alone = dc.recording_from_cube(simulated(small), small)
    alone = replace(alone, contents=replace(alone.contents, decode=None))
    with pytest.raises(RecordingError, match="contains detections without samples"):
        dc.write(alone, tmp_path / "cube.nc")


_WRITE_WITH_LITTLE_ROOM = """
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


@BOTH
@pytest.mark.skipif(sys.platform == "win32", reason="no limit of file sizes")
def test_wherever_the_disk_is_full_the_earlier_file_stays_as_it_was(tmp_path, small, ending):
    path = tmp_path / f"cube{ending}"
    written(path, simulated(small), small, truth=dc.truth(SCENE, small, n_frames=3))
    before = path.read_bytes()
    # In a process of its own: HDF5 may crash one in which it could not write.
    command = [sys.executable, "-c", _WRITE_WITH_LITTLE_ROOM, str(path), str(len(before))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == before


def test_frames_are_read_and_written_one_after_the_other(tmp_path, small):
    cube, steps = simulated(small), []
    source = dc.recording_from_cube(cube, small)

    def decode(number, out):
        steps.append(number)
        out[:] = cube.values[number]

    source = replace(source, contents=replace(source.contents, decode=decode))
    dc.write(source, tmp_path / "cube.h5", progress=lambda *done: steps.append(done))
    assert steps == [0, (1, 3), 1, (2, 3), 2, (3, 3)]


def test_an_error_while_a_frame_is_read_leaves_the_earlier_file(tmp_path, small):
    written(tmp_path / "cube.h5", simulated(small), small)
    before = (tmp_path / "cube.h5").read_bytes()
    source = dc.recording_from_cube(simulated(small), small)

    def broken(number, out):
        if number == 1:
            raise OSError(28, "No space left on device")
        out[:] = 0

    source = replace(source, contents=replace(source.contents, decode=broken))
    with pytest.raises(DechirpError, match="No space left"):
        dc.write(source, tmp_path / "cube.h5")
    assert [file.name for file in tmp_path.iterdir()] == ["cube.h5"]
    assert (tmp_path / "cube.h5").read_bytes() == before


# --- What was damaged -----------------------------------------------------------------


def changed(path, change):
    with h5py.File(path, "r+") as file:
        change(file)


def replaced(old, new):
    def change(file):
        text = file.attrs["dechirp"].decode()
        assert old in text
        file.attrs["dechirp"] = np.bytes_(text.replace(old, new))

    return change


def another_dataset(name, **how):
    def change(file):
        del file[name]
        file.create_dataset(name, **how)

    return change


def link(name, to):
    def change(file):
        del file[name]
        file[name] = to

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (replaced('"dechirp_exchange": 1', '"dechirp_exchange": 7'), "version 7"),
        (replaced("sqrt(W)", "volt"), "volt"),
        (replaced("n_samples", "n_sampels"), "unreadable radar"),
        (replaced('"target"', '"tar"'), "truth"),
        (replaced('"scale": null', '"scale": 0.5'), "scale of 0.5"),
        (lambda file: file.pop("cube"), "cube"),
        (lambda file: file.pop("truth"), "truth"),
        (link("cube", h5py.ExternalLink("other.h5", "cube")), "a link to other.h5"),
        (another_dataset("cube", shape=(3, 6, 2, 32), dtype=np.complex64), "never written"),
        (another_dataset("truth/range", shape=(2**40,), dtype="f8", chunks=(2**10,)), "bytes"),
        (another_dataset("truth/range", data=["a", "b"]), "truth"),
        (another_dataset("gap", data=np.zeros((3, 5), np.uint8)), "gap of 3 x 5"),
    ],
)
def test_a_file_of_ours_that_was_changed_says_what_is_wrong(tmp_path, small, change, said):
    path = tmp_path / "cube.h5"
    cube = simulated(small).assign_coords(gap=(("frame", "chirp"), np.zeros((3, 6), bool)))
    written(path, cube, small, truth=dc.truth(SCENE, small, n_frames=3))
    changed(path, change)
    with pytest.raises(RecordingError, match=said):
        dc.open(path)


def test_a_radar_of_many_calibrated_channels_comes_back(tmp_path, small):
    # Its description is longer than the 64 KiB that an attribute of the oldest files has.
    array = dc.Array(rx_m=[(0, 2e-3 * place, 0) for place in range(900)])
    gain = np.random.default_rng(2).normal(size=(900, 2))
    calibration = Calibration(elements=tuple((0, rx) for rx in range(900)), gain=gain)
    radar = replace(small, array=array, calibration=calibration)
    frame = replace(radar.frame, chirp=replace(radar.frame.chirp, n_samples=4), n_chirps=2)
    radar = replace(radar, frame=frame)
    samples = np.ones((1, 2, 900, 4), np.complex64)
    cube = label_cube(samples, radar, units="full scale")
    opened = written(tmp_path / "cube.nc", cube, radar)
    with h5py.File(tmp_path / "cube.nc") as file:
        assert len(file.attrs["dechirp"]) > 2**16
    must_be_equal(opened, cube, radar)


def test_a_text_of_variable_length_is_no_description(tmp_path, small):
    # HDF5 never ends reading one that is damaged.
    path = tmp_path / "cube.h5"
    written(path, simulated(small), small)
    changed(path, lambda file: file.attrs.create("dechirp", file.attrs["dechirp"].decode()))
    with pytest.raises(RecordingError, match="axes"):
        dc.open(path, radar=small)


def test_a_description_that_is_none_leaves_any_hdf5_file(tmp_path, small):
    path = tmp_path / "cube.h5"
    written(path, simulated(small), small)
    changed(path, lambda file: file.attrs.create("dechirp", b"{"))
    with pytest.raises(RecordingError, match="axes"):
        dc.open(path, radar=small)


@settings(max_examples=60)
@given(data=st.data())
def test_any_damage_gives_a_cube_or_says_why(tmp_path_factory, small, data):
    path = tmp_path_factory.mktemp("damaged") / "cube.h5"
    cube = simulated(small, n_frames=1, bits=8)
    written(path, cube, small, truth=dc.truth(SCENE, small))
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    gives_a_cube_or_says_why(path)


# --- A real recording -----------------------------------------------------------------


@BOTH
@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
@pytest.mark.parametrize(
    "name", ["awr1642_vibrating_pipe/vibration_2.bin", "bgt60_people_room/RadarIfxAvian_00"]
)
def test_a_real_recording_comes_back_equal(tmp_path, name, ending):
    recording = dc.open(Path(os.environ["DECHIRP_REAL_DATA"]) / name)
    recording = recording.select_frames(0, min(recording.n_frames, 20))
    dc.write(recording, tmp_path / f"cube{ending}")
    opened = dc.open(tmp_path / f"cube{ending}")
    assert opened.radar == recording.radar
    for own, other in zip(recording.frames(), opened.frames(), strict=True):
        xr.testing.assert_identical(other, own)
