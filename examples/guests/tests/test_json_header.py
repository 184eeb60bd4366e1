"""JSON-header plug-in: reading, inspection, and rejection of damaged files."""

import json

import numpy as np
import pytest

import dechirp as dc

RADAR_SETTINGS = {
    "frame": {
        "chirp": {
            "start_frequency": "77 GHz",
            "slope": "20 MHz/us",
            "adc_start": "2 us",
            "ramp_duration": "30 us",
            "sample_rate": "10 MHz",
            "n_samples": 256,
            "sampling": "complex",
        },
        "n_chirps": 64,
        "interval": "35 us",
    },
    "array": {"rx": [[0, 0, 0], [0, "1.9 mm", 0]]},
    "hardware": {"transmit_power": "16 mW", "antenna_gain": 10, "noise_factor": 16},
}
"""The radar of the fixture `radar`."""
SCENE = dc.Scene(
    targets=[
        dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(-5, 0, 0)),
        dc.Target(position_m=(50, 4, 0), rcs_m2=30.0),
    ]
)


@pytest.fixture
def cube(radar):
    return dc.simulate(
        SCENE, radar, impairments=[dc.impairments.ThermalNoise()], n_frames=2, seed=3
    )


def write_recording(path, cube, radar, **header_changes):
    """Write a header line and codes like a logger."""
    step = float(abs(cube).max()) / 2**15
    codes = np.round(cube.values.view(np.float32) / step).astype("<i2")
    header = {"json_header": 1, "radar": RADAR_SETTINGS, "step": step, **header_changes}
    path.write_bytes(json.dumps(header).encode() + b"\n" + codes.tobytes())
    return path


def test_recording_gives_same_detections_as_cube(tmp_path, radar, cube):
    path = write_recording(tmp_path / "logged.dat", cube, radar)
    recording = dc.open(path)
    assert recording.format == "json-header" and recording.radar == radar
    step = float(abs(cube).max()) / 2**15
    assert abs(recording.cube - cube).max() < 0.8 * step  # half a step in I, and in Q

    first, second = dc.detect(cube, radar), dc.detect(recording.cube, radar)
    assert first.sizes["detection"] == second.sizes["detection"] == 4
    for name in ("range", "velocity"):
        errors = abs(first[name].values - second[name].values)
        assert np.all(errors < 0.5 * first[f"{name}_std"].values)
    report = dc.inspect(path)
    assert report.formats == ("json-header",) and report.findings == ()


def test_full_scale_is_one_without_step(tmp_path, radar, cube):
    recording = dc.open(write_recording(tmp_path / "logged.dat", cube, radar, step=None))
    assert recording.contents.units == "1"
    assert abs(recording.cube).max() == pytest.approx(1, abs=1e-4)


def test_rejects_or_reports_damaged_files(tmp_path, radar, cube):
    path = write_recording(tmp_path / "logged.dat", cube, radar, step=-1.0)
    with pytest.raises(dc.RecordingError, match="a step of -1.0"):
        dc.open(path)
    contents = write_recording(path, cube, radar).read_bytes()
    path.write_bytes(contents[: len(contents) * 3 // 4])
    recording = dc.open(path)
    assert recording.sizes["frame"] == 1
    assert any("left out" in finding.value for finding in recording.findings)
    path.write_bytes(contents.replace(b'"radar"', b'"rader"', 1))
    with pytest.raises(dc.RecordingError, match="radar"):
        dc.open(path)
    path.write_bytes(b'{"json_header": 1, "radar": ')
    with pytest.raises(dc.RecordingError, match="no JSON"):
        dc.open(path)
