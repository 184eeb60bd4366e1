"""`dechirp calibrate`: measurement, calibration file, and its use in runs and settings."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.recordings.settings.calibration import format_calibration_json, read_calibration
from dechirp.recordings.settings.read import read_radar
from nightly import nightly

pytestmark = pytest.mark.usefixtures("without_figures")


RADAR = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 16 us,
          sample_rate: 10 MHz, n_samples: 128, sampling: complex}
  n_chirps: 16
  interval: 20 us
  multiplexing: {kind: tdm, order: [0, 1]}
array:
  tx: [[0, 0, 0], [0, 7.74 mm, 0]]
  rx: [[0, 0, 0], [0, 1.935 mm, 0], [0, 3.87 mm, 0], [0, 5.805 mm, 0]]
hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
"""
PHASES = (0.0, 0.5, -0.9, -0.6)
RECORDING_OPTIONS = ("--radar", "radar.yaml", "--axes", "frame,chirp,rx,sample")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    """Record reflectors at 25 and -40 degrees, 12 m away, with unequal receiver phases."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "radar.yaml").write_text(RADAR)
    radar = read_radar(folder / "radar.yaml")
    mismatch = dc.impairments.ChannelMismatch(gains=(1.0,) * 4, phases_rad=PHASES)
    for name, azimuth_deg in (("left", 25.0), ("right", -40.0)):
        direction = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
        scene = dc.Scene(targets=[dc.Target(position_m=tuple(12 * direction), rcs_m2=1.0)])
        cube = dc.simulate(
            scene, radar, impairments=[mismatch, dc.impairments.ThermalNoise()], seed=1
        )
        np.save(folder / f"{name}.npy", cube.values / abs(cube.values).max())
    return folder


@pytest.fixture
def folder(recordings, tmp_path, monkeypatch) -> Path:
    """Change to a folder with the recordings and their radar."""
    shutil.copytree(recordings, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_cli(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_info:
        main([*arguments])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


CALIBRATE_LEFT = (
    "calibrate",
    "left.npy",
    "--azimuth",
    "25 deg",
    "--range",
    "12 m",
    *RECORDING_OPTIONS,
)


def test_calibration_is_measured_written_and_printed(folder, capsys):
    status, out, err = run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json", "--json")

    document = json.loads(out)
    assert (status, err) == (0, "")
    assert document["calibration"] == json.loads((folder / "cal.json").read_text())
    assert list(document["calibration"]) == [
        "elements",
        "gain",
        "position_error_m",
        "range_offset_m",
        "residual",
    ]
    rows = document["elements"]
    phase_sums_deg = np.array([row["phase_deg"] for row in rows]) + np.degrees(np.tile(PHASES, 2))
    assert np.ptp(phase_sums_deg) < 8 * max(row["phase_std_deg"] for row in rows)
    assert document["files"] == {"calibration": "cal.json"}

    _, table, _ = run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json")
    assert "8 elements" in table
    assert "Residual" in table


def test_each_recording_takes_its_angle_in_order(folder, capsys):
    arguments = (
        "calibrate",
        "left.npy",
        "--azimuth",
        "25 deg",
        "right.npy",
        "--azimuth",
        "-40 deg",
    )

    status, out, _ = run_cli(capsys, *arguments, *RECORDING_OPTIONS, "--json")

    document = json.loads(out)
    assert status == 0
    assert document["range_m"] == pytest.approx([12, 12], abs=0.02)
    assert np.abs(document["calibration"]["position_error_m"]).max() < 2e-5
    assert document["findings"] == []
    assert read_calibration("calibration.json").residual < 0.05


@nightly
def test_calibration_corrects_azimuth_of_run(folder, capsys):
    run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json")
    strongest_rows = {}
    for name, options in (("before", ()), ("after", ("--calibration", "cal.json"))):
        arguments = ("run", "right.npy", *RECORDING_OPTIONS, *options, "--out", name, "--json")
        status, out, _ = run_cli(capsys, *arguments)
        assert status == 0
        rows = json.loads(out)["detections"]
        strongest_rows[name] = max(rows, key=lambda row: row["snr_db"])

    assert abs(strongest_rows["before"]["azimuth_deg"] + 40) > 1.0
    row = strongest_rows["after"]
    assert abs(row["azimuth_deg"] + 40) < max(6 * row["azimuth_std_deg"], 0.1)
    # The written scenario contains the calibration, so the run can be repeated.
    _, second_output, _ = run_cli(capsys, "run", "after/scenario.yaml", "--out", "again", "--json")
    assert max(json.loads(second_output)["detections"], key=lambda row: row["snr_db"]) == row


def test_radar_settings_accept_calibration_file_or_inline_mapping(folder, capsys):
    run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json")
    (folder / "sub").mkdir()
    (folder / "cal.json").rename(folder / "sub" / "cal.json")
    expected = read_calibration("sub/cal.json")
    (folder / "sub" / "radar.yaml").write_text(RADAR + "calibration: cal.json\n")
    (folder / "inline.yaml").write_text(RADAR + format_inline_calibration(expected))

    assert read_radar("sub/radar.yaml").calibration == expected
    assert read_radar("inline.yaml").calibration == expected
    recording = dc.open("left.npy", radar="radar.yaml", axes="frame,chirp,rx,sample",
                     calibration="sub/cal.json")  # fmt: skip
    assert recording.radar.calibration == expected
    inspection = dc.inspect("left.npy", radar="sub/radar.yaml", axes="frame,chirp,rx,sample")
    assert inspection.recording.radar.calibration == expected
    (folder / "sub" / "scenario.yaml").write_text(
        "radar: radar.yaml\nscene: {targets: [{position: [20 m, 0, 0]}]}\n"
    )
    assert dc.load("sub/scenario.yaml").radar.calibration == expected


def format_inline_calibration(calibration: dc.Calibration) -> str:
    return (
        f"calibration: {{elements: {[list(e) for e in calibration.elements]},"
        f" gain: {[list(g) for g in calibration.gain]},"
        f" range_offset: {calibration.range_offset_m!r} m, residual: {calibration.residual!r}}}\n"
    )


def test_calibration_file_reads_back_equal(tmp_path):
    rng = np.random.default_rng(1)
    for position_errors_m in (None, [tuple(row) for row in rng.normal(0, 1e-4, (3, 3))]):
        calibration = dc.Calibration(
            elements=[(1, 0), (0, 0), (2, 0)],
            gain=[tuple(row) for row in rng.normal(size=(3, 2))],
            position_error_m=position_errors_m,
            range_offset_m=rng.normal(),
            residual=None if position_errors_m is None else 0.1,
        )
        (tmp_path / "cal.json").write_text(format_calibration_json(calibration))
        assert read_calibration(tmp_path / "cal.json") == calibration


@nightly
def test_result_store_contains_calibration(folder, capsys):
    run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json")
    expected = read_calibration("cal.json")
    arguments = (
        "run",
        "left.npy",
        *RECORDING_OPTIONS,
        "--calibration",
        "cal.json",
        "--out",
        "results",
    )
    run_cli(capsys, *arguments, "--quiet")

    assert dc.open("results").radar.calibration == expected
    group = xr.open_zarr("results/cube.zarr", group="calibration", consolidated=False)
    gains = np.array(expected.gain) @ np.array([1, 1j])
    np.testing.assert_array_equal(group.gain.values, gains)
    assert list(zip(group.tx.values, group.rx.values, strict=True)) == list(expected.elements)
    assert group.attrs["range_offset_m"] == expected.range_offset_m


VALID_CALIBRATION = {"elements": [[0, 0], [0, 1]], "gain": [[1.0, 0.0], [0.5, 0.5]]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "the file: not JSON from line 1"),
        ("[1]", "the file: JSON of a list"),
        ("\xff", "the file: not JSON"),
        ("[" * 100_000, "the file: not JSON"),
        (json.dumps({**VALID_CALIBRATION, "gains": []}), "gains: an unknown key"),
        (json.dumps({"gain": VALID_CALIBRATION["gain"]}), "elements: missing"),
        (json.dumps({**VALID_CALIBRATION, "gain": [[1.0, 0.0]]}), "gain: a list of 1"),
        (json.dumps({**VALID_CALIBRATION, "gain": [[1.0, 0.0], ["a", 0]]}), "gain.1: 'a'"),
        (json.dumps({**VALID_CALIBRATION, "gain": None}), "gain: None"),
        (json.dumps({**VALID_CALIBRATION, "residual": float("nan")}), "residual: nan"),
        (json.dumps({**VALID_CALIBRATION, "elements": [[0, 0], [0, 0.5]]}), "elements.1: 0.5"),
        (json.dumps({**VALID_CALIBRATION, "position_error_m": "here"}), "position_error_m: here"),
        (json.dumps(VALID_CALIBRATION), "none for [0, 2]"),
        (json.dumps({**VALID_CALIBRATION, "gain": {"a": 1}}), "gain: {'a': 1}; expected a list"),
        (
            json.dumps({**VALID_CALIBRATION, "elements": {"0": 0}}),
            "elements: {'0': 0}; expected a list",
        ),
        (
            json.dumps({**VALID_CALIBRATION, "gain": [[10**400, 0], [1, 0]]}),
            "000...; expected one finite",
        ),
        (
            json.dumps({**VALID_CALIBRATION, "gain": [[0.0, 0.0], [1, 0]]}),
            "magnitude from 1e-6 to 1e6",
        ),
        (json.dumps({"elements": [], "gain": []}), "elements: []; expected a list of pairs"),
    ],
)
def test_rejects_damaged_calibration_file_with_name_and_key(folder, capsys, content, message):
    (folder / "cal.json").write_bytes(content.encode("latin-1"))

    status, _, err = run_cli(
        capsys, "run", "left.npy", *RECORDING_OPTIONS, "--calibration", "cal.json"
    )

    assert status == 2
    assert message in err
    assert "Traceback" not in err
    assert "cal.json" in err or "Radar.calibration" in err


INVALID_CALLS = {
    "--azimuth: missing": ("left.npy",),
    "left.npy, given twice": ("left.npy", "left.npy", "--azimuth", "0", "--azimuth", "0"),
    "--range: -3.0": ("left.npy", "--azimuth", "0", "--range", "-3 m"),
    "--azimuth: nan deg": ("left.npy", "--azimuth", "nan deg"),
    "gone.json: the file: missing": (
        *("left.npy", "--azimuth", "0", "--calibration", "gone.json"),
    ),
    "RECORDING: missing": ("--azimuth", "25 deg"),
    "one azimuth for each of the 2": ("left.npy", "right.npy", "--azimuth", "25 deg"),
    'an angle with its unit; write --azimuth "25 deg"': ("left.npy", "--azimuth", "25"),
    "--azimuth: 2.09": ("left.npy", "--azimuth", "120 deg"),
    "--elevation: -1.7": ("left.npy", "--azimuth", "0", "--elevation", "-100 deg"),
    "--range: 12; expected a length": ("left.npy", "--azimuth", "0", "--range", "12"),
    "--range: 2 numbers for 1": (
        *("left.npy", "--azimuth", "0", "--range", "12 m", "--range", "13 m"),
    ),
    "the recording: no static echo": ("left.npy", "--azimuth", "0", "--range", "40 m"),
    "gone.npy": ("gone.npy", "--azimuth", "0"),
    "an existing file that is not a calibration": (
        *("left.npy", "--azimuth", "0", "--out", "radar.yaml"),
    ),
    "not writable": ("left.npy", "--azimuth", "25 deg", "--out", "gone/cal.json"),
}


@pytest.mark.parametrize(("message", "options"), INVALID_CALLS.items())
def test_rejects_invalid_calls_with_message(folder, capsys, message, options):
    status, out, err = run_cli(capsys, "calibrate", *options, *RECORDING_OPTIONS)
    as_json = run_cli(capsys, "calibrate", *options, *RECORDING_OPTIONS, "--json")

    assert (status, out) == (2, "")
    assert message in err
    assert as_json[0] == 2
    assert set(json.loads(as_json[1])["errors"][0]) >= {"setting", "value", "expected", "fix"}
    assert (folder / "radar.yaml").read_text() == RADAR


def test_rejects_recordings_of_different_radars(folder, capsys):
    (folder / "left.yaml").write_text(RADAR)
    (folder / "right.yaml").write_text(RADAR.replace("slope: 20", "slope: 19"))
    (folder / "radar.yaml").unlink()
    arguments = ("calibrate", "left.npy", "right.npy", "--azimuth", "0", "--azimuth", "0")

    status, _, err = run_cli(capsys, *arguments, "--axes", "frame,chirp,rx,sample")

    assert status == 2
    assert "radar or waveform different from left.npy" in err


@nightly
def test_simulated_scene_takes_calibration_from_setting_only(folder, capsys):
    run_cli(capsys, *CALIBRATE_LEFT, "--out", "cal.json")
    (folder / "scenario.yaml").write_text(
        "radar: radar.yaml\nscene: {targets: [{position: [20 m, 0, 0]}]}\n"
    )

    status, _, err = run_cli(capsys, "run", "scenario.yaml", "--calibration", "cal.json")
    assert (status, "--calibration: given for a simulated scene" in err) == (2, True)

    setting = ("--set", "radar.calibration=cal.json", "--quiet")
    assert run_cli(capsys, "run", "scenario.yaml", *setting)[0] == 0


def test_calibration_with_default_array_warns(folder, capsys):
    """Phases are measured relative to the element positions, so wrong positions enter them."""
    bare = RADAR[: RADAR.index("  multiplexing")].replace("n_chirps: 16", "n_chirps: 32")
    (folder / "bare.yaml").write_text(bare)
    arguments = ("calibrate", "left.npy", "--azimuth", "25 deg", "--radar", "bare.yaml")

    status, out, _ = run_cli(capsys, *arguments, "--axes", "frame,chirp,rx,sample", "--json")

    findings = json.loads(out)["findings"]
    assert status == 0
    assert [finding["level"] for finding in findings if finding["setting"] == "radar.array.rx"] == [
        "warning"
    ]
    assert any("--device" in finding["fix"] for finding in findings)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("chain.angle=fft", "write {kind: fft}"),
        ("chain.angle=[]", "an empty list; expected a mapping with kind"),
        ("chain.angle={kind: mus}", "did you mean music?"),
        ("chain.angle={kind: music, n_sources: 99}", "fewer than the 8 elements"),
        ("chain.angle={kind: capon, loading: .nan}", "such as 4"),
        ("chain.angle={kind: monopulse, n_sources: 2}", "expected 1, since"),
        ("chain.field_of_view={azimuth: 100 deg}", "(90 deg)"),
        ("chain.field_of_view={azimuth: [-30 deg, 30 deg]}", "write one number"),
        ("radar.calibration={elements: [], gain: []}", "a list of pairs"),
        ("radar.calibration={gain: 3}", "elements: missing"),
        ("radar.calibration=gone.json", "the file: missing"),
    ],
)
def test_rejects_invalid_angle_and_calibration_settings_with_name(folder, capsys, setting, message):
    status, out, err = run_cli(capsys, "run", "left.npy", *RECORDING_OPTIONS, "--set", setting)

    assert (status, out) == (2, "")
    assert message in err and "Traceback" not in err
    assert setting.partition("=")[0] in err or "gone.json" in err


def test_run_accepts_field_of_view_of_single_beam(folder, capsys):
    setting = ("--set", "chain.field_of_view={azimuth: 0.5 deg}", "--quiet")
    assert run_cli(capsys, "run", "left.npy", *RECORDING_OPTIONS, *setting) == (0, "", "")
