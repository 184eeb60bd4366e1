"""Slow-time files: Acconeer's HDF5 and CSV, with damaged and wrong ones."""

import json

import h5py
import numpy as np
import pytest

import dechirp as dc
from dechirp.core import compiled_kernels
from dechirp.recordings import slow_time_files

N_FRAMES, N_SWEEPS, N_POINTS = 30, 4, 3
ENTRY = "sessions/session_0/group_0/entry_0"


def write_acconeer(path, **changes):
    """Write a file as the Exploration Tool does; return its frames, (frame, sweep, point)."""
    rng = np.random.default_rng(5)
    frames = np.zeros((N_FRAMES, N_SWEEPS, N_POINTS), [("real", "<i2"), ("imag", "<i2")])
    for name in ("real", "imag"):
        frames[name] = rng.integers(-2000, 2000, frames.shape)
    subsweeps = [
        {"start_point": 100, "num_points": 2, "step_length": 10},
        {"start_point": 200, "num_points": 1, "step_length": 5},
    ]
    contents = {
        f"{ENTRY}/result/frame": frames,
        f"{ENTRY}/result/tick": 50_000 * np.arange(N_FRAMES),
        f"{ENTRY}/sensor_id": 2,
        f"{ENTRY}/metadata": json.dumps({"base_step_length_m": 0.0025}),
        "server_info": json.dumps({"ticks_per_second": 1_000_000}),
        "sessions/session_0/session_config": json.dumps(
            {"groups": [{"2": {"subsweeps": subsweeps}}]}
        ),
    } | changes
    with h5py.File(path, "w") as file:
        for name, content in contents.items():
            if content is not None:
                file[name] = content
    return frames


@pytest.mark.parametrize("can_compile", [True, False])
def test_acconeer_frames_are_means_of_sweeps(can_compile, tmp_path, monkeypatch):
    if not can_compile:
        monkeypatch.setattr(compiled_kernels, "can_compile", lambda: False)
    frames = write_acconeer(tmp_path / "a.h5")
    trace = dc.slow_time_files.read_slow_time(tmp_path / "a.h5")
    assert trace.dims == ("time", "range")
    np.testing.assert_allclose(trace.real, frames["real"].mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(trace.imag, frames["imag"].mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(trace.time, 0.05 * np.arange(N_FRAMES), atol=1e-12)
    np.testing.assert_allclose(trace.range, [0.25, 0.275, 0.5], rtol=1e-12)
    assert trace.attrs["wavelength_m"] == pytest.approx(4.9552e-3, rel=1e-4)
    assert (
        dc.slow_time_files.read_slow_time(tmp_path / "a.h5", wavelength_m=5e-3).attrs[
            "wavelength_m"
        ]
        == 5e-3
    )


@pytest.mark.parametrize(
    ("name", "unit_s"),
    [
        ("time (ms)", 1e-3),
        ("timestamp_us", 1e-6),
        ("t [ns]", 1e-9),
        ("time_s", 1),
        ("Time ms", 1e-3),
    ],
)
def test_times_of_csv_are_in_the_unit_of_their_name(tmp_path, name, unit_s):
    (tmp_path / "a.csv").write_text(f"{name},I,Q\n0,1,2\n50,3,4\n")
    trace = dc.slow_time_files.read_slow_time(tmp_path / "a.csv")
    np.testing.assert_allclose(trace.time, [0, 50 * unit_s])


@pytest.mark.parametrize("number_type", ["<i2", "<f4"])
@pytest.mark.parametrize("n_block", [1, 7, 100])
def test_means_of_sweeps_are_the_same_in_blocks_of_any_size(
    n_block, number_type, tmp_path, monkeypatch
):
    types = [("real", number_type), ("imag", number_type)]
    frames = write_acconeer(tmp_path / "a.h5").astype(types)
    write_acconeer(tmp_path / "a.h5", **{f"{ENTRY}/result/frame": frames})
    frame_bytes = N_SWEEPS * N_POINTS * frames.dtype.itemsize
    monkeypatch.setattr(slow_time_files, "_BLOCK_BYTES", n_block * frame_bytes)
    trace = dc.slow_time_files.read_slow_time(tmp_path / "a.h5")
    np.testing.assert_allclose(trace.real, frames["real"].mean(axis=1, dtype=float), atol=1e-9)
    np.testing.assert_allclose(trace.imag, frames["imag"].mean(axis=1, dtype=float), atol=1e-9)


def test_acconeer_file_of_an_older_version_has_one_session(tmp_path):
    write_acconeer(tmp_path / "new.h5")
    write_acconeer(tmp_path / "old.h5")
    with h5py.File(tmp_path / "old.h5", "a") as file:
        file.move("sessions/session_0", "session")
        del file["sessions"]
    traces = [dc.slow_time_files.read_slow_time(tmp_path / name) for name in ("new.h5", "old.h5")]
    assert traces[1].identical(traces[0])


def test_longest_acconeer_session_is_read_with_a_warning(tmp_path):
    """A detector that sleeps writes a session of few frames before and after each presence."""
    write_acconeer(tmp_path / "a.h5")
    write_acconeer(tmp_path / "b.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file, h5py.File(tmp_path / "b.h5") as long:
        file.move("sessions/session_0", "sessions/session_1")
        long.copy("sessions/session_0", file["sessions"], "session_0")
        for name in ("frame", "tick"):
            values = file[f"{ENTRY}/result/{name}"][:3]
            del file[f"{ENTRY}/result/{name}"]
            file[f"{ENTRY}/result/{name}"] = values
    with pytest.warns(dc.PhysicsWarning, match="2 sessions or sensors; sessions/session_1/.* 30"):
        trace = dc.slow_time_files.read_slow_time(tmp_path / "a.h5")
    assert trace.identical(dc.slow_time_files.read_slow_time(tmp_path / "b.h5"))


@pytest.mark.parametrize("has_times", [True, False])
def test_iq_service_of_acconeers_a111(tmp_path, has_times):
    rng = np.random.default_rng(1)
    sweeps = rng.normal(size=(20, 1, 5)) + 1j * rng.normal(size=(20, 1, 5))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = sweeps
        file["mode"] = "iq"
        file["sensor_config_dump"] = json.dumps({"mode": "IQ", "update_rate": 10.0})
        file["session_info"] = json.dumps({"range_start_m": 0.4, "range_length_m": 0.4})
        if has_times:
            file["sample_times"] = 1.6e9 + 0.1 * np.arange(20)
    trace = dc.slow_time_files.read_slow_time(tmp_path / "a.h5")
    np.testing.assert_array_equal(trace, sweeps[:, 0])
    np.testing.assert_allclose(trace.range, [0.4, 0.5, 0.6, 0.7, 0.8])
    np.testing.assert_allclose(np.diff(trace.time), 0.1, atol=1e-6)


def test_service_of_acconeers_a111_without_phases_is_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = np.zeros((10, 1, 64, 17), np.uint16)
        file["mode"] = "sparse"
        file["sensor_config_dump"] = "{}"
    with pytest.raises(dc.RecordingError, match="service sparse of .* without I and Q"):
        dc.slow_time_files.read_slow_time(tmp_path / "a.h5")


def test_empty_file_is_named_so(tmp_path):
    (tmp_path / "a.h5").touch()
    with pytest.raises(dc.RecordingError, match="an empty file"):
        dc.slow_time_files.read_slow_time(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("heading", "separator"),
    [
        ("time,I,Q", ","),
        ("t (s);in-phase;quadrature", ";"),
        ("Time\tSignal [I]\tSignal [Q]", "\t"),
        ("\ufeffSignal [I]_x,Signal [I]_y,Signal [Q]_y", ","),
    ],
)
def test_csv_columns_are_found_by_their_names(tmp_path, heading, separator):
    numbers = [(0.0, 1.5, -2.0), (0.05, 1e-3, 2.5), (0.11, -4.0, 0.0)]
    lines = [heading, *(separator.join(map(str, row)) for row in numbers)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    trace = dc.slow_time_files.read_slow_time(tmp_path / "a.csv")
    np.testing.assert_array_equal(trace, [1.5 - 2j, 1e-3 + 2.5j, -4])
    np.testing.assert_array_equal(trace.time, [0, 0.05, 0.11])
    assert "wavelength_m" not in trace.attrs


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an empty file"),
        ("time,a,b\n0,1,2\n", "0 columns for I in the heading"),
        ("time,I,I (2),Q\n0,1,2,3\n", "2 columns for I"),
        ("I,Q\n1,2\n2,3\n", "0 columns for time"),
        ("time,I,Q\n0,1,2\n", "1 lines"),
        ("time,I,Q\n1,1,2\n0,1,2\n", "times that decrease"),
        ("time,I,Q\n0,1,2\n1,nan,2\n", "not finite"),
        ("time,I,Q\n0,1,2\n1,2\n", "not readable"),
        ("time,I,Q\n0,1,x\n1,2,3\n", "not readable"),
    ],
)
def test_wrong_text_is_refused_with_reason(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(dc.DechirpError, match=message):
        dc.slow_time_files.read_slow_time(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "changes",
    [
        {f"{ENTRY}/result/frame": None},
        {f"{ENTRY}/result/frame": np.zeros((30, 4, 3))},
        {f"{ENTRY}/result/tick": None},
        {f"{ENTRY}/result/tick": np.arange(7)},
        {f"{ENTRY}/sensor_id": 3},
        {f"{ENTRY}/metadata": "{"},
        {f"{ENTRY}/metadata": np.arange(3)},
        {"server_info": None},
        {"server_info": json.dumps({"ticks_per_second": 0})},
        {"sessions/session_0/session_config": json.dumps({"groups": []})},
    ],
)
def test_wrong_hdf5_is_refused(tmp_path, changes):
    write_acconeer(tmp_path / "a.h5", **changes)
    with pytest.raises(dc.DechirpError, match="recording"):
        dc.slow_time_files.read_slow_time(tmp_path / "a.h5")


def test_text_in_a_damaged_heap_is_refused_at_once(tmp_path):
    write_acconeer(tmp_path / "a.h5")
    content = bytearray((tmp_path / "a.h5").read_bytes())
    heap = content.index(b"GCOL")
    # HDF5 2.0 reads free space of no size for ever.
    for number, sizes in ((1, (0, 2**60)), (2, (0,)), (3, (5,)), (0, (0,))):
        for size in sizes:
            damaged = content.copy()
            position = heap + 16
            while (index := int.from_bytes(damaged[position : position + 2], "little")) != number:
                n_bytes = int.from_bytes(damaged[position + 8 : position + 16], "little")
                assert index != 0
                position += 16 + -(-n_bytes // 8) * 8
            damaged[position + 8 : position + 16] = size.to_bytes(8, "little")
            (tmp_path / "b.h5").write_bytes(damaged)
            if number == 0:
                assert dc.slow_time_files.read_slow_time(tmp_path / "b.h5").sizes["time"] == 30
            else:
                with pytest.raises(dc.RecordingError):
                    dc.slow_time_files.read_slow_time(tmp_path / "b.h5")


def test_mutated_files_are_read_or_refused(tmp_path):
    write_acconeer(tmp_path / "a.h5")
    (tmp_path / "a.csv").write_text("time,I,Q\n" + "".join(f"{k},{k}.5,-{k}\n" for k in range(20)))
    rng = np.random.default_rng(7)
    for name in ("a.h5", "a.csv"):
        whole = (tmp_path / name).read_bytes()
        for _ in range(60):
            damaged = bytearray(
                whole[: rng.integers(1, len(whole))] if rng.random() < 0.3 else whole
            )
            for place in rng.integers(0, len(damaged), rng.integers(1, 6)):
                damaged[place] = rng.integers(256)
            (tmp_path / "damaged").write_bytes(damaged)
            try:
                trace = dc.slow_time_files.read_slow_time(tmp_path / "damaged")
            except dc.DechirpError:
                continue
            assert trace.sizes["time"] > 0


def test_missing_file_and_wrong_wavelength(tmp_path):
    with pytest.raises(dc.DechirpError, match="no file"):
        dc.slow_time_files.read_slow_time(tmp_path / "none.csv")
    for wrong in (0.0, -1.0, np.nan, "5 mm"):
        with pytest.raises(dc.InvalidSetting, match="wavelength_m"):
            dc.slow_time_files.read_slow_time(tmp_path / "none.csv", wavelength_m=wrong)
