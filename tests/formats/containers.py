"""Recordings that a container of ours has to keep, and what it owes them."""

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
from radars import of_street

SCENE = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 1, 0), velocity_m_per_s=(3, 0, 0), rcs_m2=10),
        dc.Target(name="Fußgänger", position_m=(9, -2, 0), rcs_m2=0.5),
    ]
)


def small(sampling="complex", **changes) -> dc.Radar:
    """Few chirps of few samples, of two receivers."""
    told = {"n_chirps": 6, "period_s": 1e-3} | changes
    return of_street(n_samples=32, sampling=sampling, **told)


def simulated(radar: dc.Radar, *, bits=None, n_frames=3) -> xr.DataArray:
    noise_w = dc.impairments.ThermalNoise().noise_power_w(SCENE, radar)
    converter = (
        []
        if bits is None
        else [dc.impairments.Quantisation(bits=bits, full_scale_w=1000 * noise_w)]
    )
    made = dc.simulate(
        SCENE, radar, impairments=[dc.impairments.ThermalNoise(), *converter], n_frames=n_frames
    )
    return made if bits is None else made.copy(data=made.values + 0)  # a code has no -0


def of_complex_samples() -> Recording:
    radar = small()
    return dc.recording_from_cube(simulated(radar), radar)


def of_real_samples() -> Recording:
    radar = small("real")
    return dc.recording_from_cube(simulated(radar), radar)


def of_transmitters_in_turns() -> Recording:
    elements = ((1, 0), (0, 0), (0, 1), (1, 1))
    calibration = Calibration(
        elements=elements,
        gain=tuple((1.0, 0.1 * tx - 0.3 * rx) for tx, rx in elements),
        position_error_m=tuple((0.0, 1e-4 * place, 0.0) for place in range(4)),
        range_offset_m=0.07,
        residual=0.01,
    )
    of = small(interval_s=(35e-6, 38e-6))
    frame = replace(of.frame, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    array = dc.Array(tx_m=[(0, 0, 0), (0, 8e-3, 0)], rx_m=of.array.rx_m)
    radar = replace(of, frame=frame, array=array, calibration=calibration)
    return dc.recording_from_cube(simulated(radar), radar)


def of_complex_codes() -> Recording:
    radar = small()
    return dc.recording_from_cube(simulated(radar, bits=12), radar)


def of_real_codes() -> Recording:
    radar = small("real")
    return dc.recording_from_cube(simulated(radar, bits=16), radar)


def of_one_number_a_frame() -> Recording:
    """Axes of 1 at the end, which MATLAB leaves out."""
    radar = replace(small(n_chirps=1), array=dc.Array())
    return dc.recording_from_cube(simulated(radar, n_frames=1), radar)


def of_lost_chirps() -> Recording:
    radar = small()
    gap = np.zeros((3, 6), bool)
    gap[0, 5] = gap[1, 0:2] = gap[2, 5] = True
    cube = simulated(radar).assign_coords(gap=(("frame", "chirp"), gap))
    cube.values[gap] = 0
    return dc.recording_from_cube(cube, radar)


def of_tables() -> Recording:
    radar = small()
    cube = simulated(radar)
    found = dc.detect(cube, radar)
    numbers = np.array([0.1, np.nan, -np.inf, np.inf, -0.0, 5e-324])
    made = xr.Dataset(
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
        "detections": found,
        "by_hand": made,
        "none": found.isel(detection=slice(0, 0)),
        "empty": xr.Dataset(attrs={"of": 1}),
    }
    return dc.recording_from_cube(cube, radar, tables=tables)


CASES = {
    made.__name__[3:]: made
    for made in (
        of_complex_samples,
        of_real_samples,
        of_transmitters_in_turns,
        of_complex_codes,
        of_real_codes,
        of_one_number_a_frame,
        of_lost_chirps,
        of_tables,
    )
}
EVERY_CASE = pytest.mark.parametrize("made", CASES.values(), ids=CASES)


def must_be_equal(opened: Recording, recording: Recording) -> None:
    """Same bits, same axes and coordinates, same radar, same tables."""
    assert opened.radar == recording.radar
    assert opened.findings == ()
    assert opened.contents.scale == recording.contents.scale
    before, after = recording.cube, opened.cube
    assert after.values.dtype == before.values.dtype
    assert after.values.tobytes() == before.values.tobytes()
    xr.testing.assert_identical(after.drop_attrs(), before.drop_attrs())
    assert after.attrs["units"] == before.attrs["units"]
    for frame, whole in zip(opened.frames(), before.values, strict=True):
        assert np.array_equal(frame.values[0], whole)
    if "scale" in after.attrs:
        assert np.array_equal(extract_adc_codes(after).values, extract_adc_codes(before).values)
    assert set(opened.tables) == set(recording.tables)
    for name, table in recording.tables.items():
        xr.testing.assert_identical(opened.tables[name], table)
        for column, variable in table.variables.items():
            again = opened.tables[name][column]
            assert again.dtype.kind == variable.dtype.kind
            if variable.dtype.kind not in "UO":
                assert again.values.dtype == variable.dtype
                assert np.array_equal(
                    np.signbit(again.values.real), np.signbit(variable.values.real)
                )


@contextmanager
def room_for(n_bytes: int):
    """No file can be longer: writing more fails as on a full disk."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def must_leave_what_was_there(out: Path) -> None:
    """Wherever in the files of a recording the disk is full."""
    first, second = of_lost_chirps(), of_tables()
    dc.write(first, out)
    before = {file.name: file.read_bytes() for file in out.parent.iterdir()}
    n_bytes = max(map(len, before.values()))
    for room in range(0, n_bytes * 3 // 4, n_bytes // 7):
        with room_for(room), pytest.raises(DechirpError, match="not writable"):
            dc.write(second, out)
        assert {file.name: file.read_bytes() for file in out.parent.iterdir()} == before


def real(folder: Path) -> Recording:
    """A recording of a TI radar in the collection of real ones."""
    whole = dc.open(folder / "awr1642_vibrating_pipe" / "vibration_2.bin")
    return whole.select_frames(0, min(whole.n_frames, 5))


def must_keep_a_real_recording(recording: Recording, out: Path) -> None:
    dc.write(recording, out)
    opened = dc.open(out)
    assert opened.radar == recording.radar
    assert opened.cube.values.tobytes() == recording.cube.values.tobytes()
