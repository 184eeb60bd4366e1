"""Native recordings for round-trip tests, and the assertions on their copies."""

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import DechirpError
from dechirp.radar.calibration import Calibration
from dechirp.recordings.recording import Recording
from dechirp.simulation.adc_codes import extract_adc_codes
from radars import street_radar

SCENE = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=10),
        dc.Target(name="Fußgänger", position_m=(9, -2, 0), rcs_m2=0.5),
    ]
)


def make_radar(sampling="complex", **changes) -> dc.Radar:
    """Make a radar with two receivers, 6 chirps and 32 samples per chirp."""
    frame_settings = {"n_chirps": 6, "period_s": 1e-3} | changes
    return street_radar(n_samples=32, sampling=sampling, **frame_settings)


def simulate_cube(radar: dc.Radar, *, bits=None, n_frames=3) -> xr.DataArray:
    noise_w = dc.impairments.ThermalNoise().noise_power_w(SCENE, radar)
    converter = (
        []
        if bits is None
        else [dc.impairments.Quantisation(bits=bits, full_scale_w=1000 * noise_w)]
    )
    cube = dc.simulate(
        SCENE, radar, impairments=[dc.impairments.ThermalNoise(), *converter], n_frames=n_frames
    )
    return cube if bits is None else cube.copy(data=cube.values + 0)  # codes have no negative zero


def make_complex_recording() -> Recording:
    radar = make_radar()
    return dc.recording_from_cube(simulate_cube(radar), radar)


def make_real_recording() -> Recording:
    radar = make_radar("real")
    return dc.recording_from_cube(simulate_cube(radar), radar)


def make_tdm_recording() -> Recording:
    elements = ((1, 0), (0, 0), (0, 1), (1, 1))
    calibration = Calibration(
        elements=elements,
        gain=tuple((1.0, 0.1 * tx - 0.3 * rx) for tx, rx in elements),
        position_error_m=tuple((0.0, 1e-4 * index, 0.0) for index in range(4)),
        range_offset_m=0.07,
        residual=0.01,
    )
    base = make_radar(interval_s=(35e-6, 38e-6))
    frame = replace(base.frame, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    array = dc.Array(tx_m=[(0, 0, 0), (0, 8e-3, 0)], rx_m=base.array.rx_m)
    radar = replace(base, frame=frame, array=array, calibration=calibration)
    return dc.recording_from_cube(simulate_cube(radar), radar)


def make_complex_code_recording() -> Recording:
    radar = make_radar()
    return dc.recording_from_cube(simulate_cube(radar, bits=12), radar)


def make_real_code_recording() -> Recording:
    radar = make_radar("real")
    return dc.recording_from_cube(simulate_cube(radar, bits=16), radar)


def make_one_sample_recording() -> Recording:
    """Make a recording with trailing axes of size 1, which MATLAB drops."""
    radar = replace(make_radar(n_chirps=1), array=dc.Array())
    return dc.recording_from_cube(simulate_cube(radar, n_frames=1), radar)


def make_gap_recording() -> Recording:
    radar = make_radar()
    gap = np.zeros((3, 6), bool)
    gap[0, 5] = gap[1, 0:2] = gap[2, 5] = True
    cube = simulate_cube(radar).assign_coords(gap=(("frame", "chirp"), gap))
    cube.values[gap] = 0
    return dc.recording_from_cube(cube, radar)


def make_table_recording() -> Recording:
    radar = make_radar()
    cube = simulate_cube(radar)
    detections = dc.detect(cube, radar)
    numbers = np.array([0.1, np.nan, -np.inf, np.inf, -0.0, 5e-324])
    manual_table = xr.Dataset(
        {
            "number": ("place", numbers, {"units": "m"}),
            "single": ("place", numbers.astype(np.float32)),
            "gain": ("pair", np.array([1 + 2j, np.nan - 1j], np.complex64)),
            "is_seen": (("pair", "frame"), np.array([[True, False, True], [False, False, True]])),
            "word": (("pair", "frame"), np.array([["", "ü", "x"], ["b", "long", "y"]])),
            "large": ("pair", np.array([2**63 - 1, -(2**63)])),
            "byte": ("pair", np.array([0, 255], np.uint8)),
            "alone": ((), np.float32(0.5)),
        },
        coords={"frame": [0, 1, 2]},
        attrs={"made": "by hand", "numbers": [1, 2]},
    )
    tables = {
        "truth": dc.truth(SCENE, radar, n_frames=3),
        "detections": detections,
        "by_hand": manual_table,
        "none": detections.isel(detection=slice(0, 0)),
        "empty": xr.Dataset(attrs={"of": 1}),
    }
    return dc.recording_from_cube(cube, radar, tables=tables)


RECORDING_MAKERS = {
    maker.__name__.removeprefix("make_").removesuffix("_recording"): maker
    for maker in (
        make_complex_recording,
        make_real_recording,
        make_tdm_recording,
        make_complex_code_recording,
        make_real_code_recording,
        make_one_sample_recording,
        make_gap_recording,
        make_table_recording,
    )
}
EVERY_RECORDING = pytest.mark.parametrize(
    "make_recording", RECORDING_MAKERS.values(), ids=RECORDING_MAKERS
)


def assert_recordings_equal(copy: Recording, recording: Recording) -> None:
    """Compare samples bit by bit, axes, coordinates, radar and tables."""
    assert copy.radar == recording.radar
    assert copy.findings == ()
    assert copy.contents.scale == recording.contents.scale
    expected_cube, cube = recording.cube, copy.cube
    assert cube.values.dtype == expected_cube.values.dtype
    assert cube.values.tobytes() == expected_cube.values.tobytes()
    xr.testing.assert_identical(cube.drop_attrs(), expected_cube.drop_attrs())
    assert cube.attrs["units"] == expected_cube.attrs["units"]
    for frame, samples in zip(copy.frames(), expected_cube.values, strict=True):
        assert np.array_equal(frame.values[0], samples)
    if "scale" in cube.attrs:
        assert np.array_equal(
            extract_adc_codes(cube).values, extract_adc_codes(expected_cube).values
        )
    assert set(copy.tables) == set(recording.tables)
    for name, table in recording.tables.items():
        xr.testing.assert_identical(copy.tables[name], table)
        for column, variable in table.variables.items():
            copied_variable = copy.tables[name][column]
            assert copied_variable.dtype.kind == variable.dtype.kind
            if variable.dtype.kind not in "UO":
                assert copied_variable.values.dtype == variable.dtype
                assert np.array_equal(
                    np.signbit(copied_variable.values.real), np.signbit(variable.values.real)
                )


@contextmanager
def limit_file_size(n_bytes: int):
    """Limit the size of files: longer writes fail as on a full disk."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def assert_full_disk_keeps_files(out: Path) -> None:
    """Fill the disk at several positions of a recording and compare the earlier files."""
    gap_recording, table_recording = make_gap_recording(), make_table_recording()
    dc.write(gap_recording, out)
    contents = {file.name: file.read_bytes() for file in out.parent.iterdir()}
    n_bytes = max(map(len, contents.values()))
    for limit in range(0, n_bytes * 3 // 4, n_bytes // 7):
        with limit_file_size(limit), pytest.raises(DechirpError, match="not writable"):
            dc.write(table_recording, out)
        assert {file.name: file.read_bytes() for file in out.parent.iterdir()} == contents


def open_real_capture(folder: Path) -> Recording:
    """Open up to five frames of a real TI recording."""
    recording = dc.open(folder / "awr1642_vibrating_pipe" / "vibration_2.bin")
    return recording.select_frames(0, min(recording.n_frames, 5))


def assert_write_preserves_recording(recording: Recording, out: Path) -> None:
    dc.write(recording, out)
    copy = dc.open(out)
    assert copy.radar == recording.radar
    assert copy.cube.values.tobytes() == recording.cube.values.tobytes()
