"""`dechirp inspect` and `dechirp.inspect`: description, map and findings of a recording."""

import json
import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

import dechirp as dc
from dechirp.cli.main import main
from dechirp.recordings.settings.read import read_radar
from nightly import nightly

RADAR = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 30 us,
          sample_rate: 10 MHz, n_samples: 64, sampling: complex}
  n_chirps: 32
  interval: 40 us
array:
  rx: [[0 mm, 0 mm, 0 mm], [0 mm, 1.9 mm, 0 mm]]
"""


def make_samples() -> np.ndarray:
    """Return int16 samples of one echo in noise, three frames (frame, chirp, rx, sample, iq)."""
    rng = np.random.default_rng(1)
    beat = 4000 * np.exp(2j * np.pi * 0.13 * np.arange(64))
    noise = 300 * (rng.standard_normal((3, 32, 2, 64)) + 1j * rng.standard_normal((3, 32, 2, 64)))
    samples = beat + noise
    return np.stack([samples.real, samples.imag], axis=-1).round().astype(np.int16)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "radar.yaml").write_text(RADAR)
    np.save("cube.npy", make_samples())
    return tmp_path


RECORDING_OPTIONS = ("--radar", "radar.yaml", "--axes", "frame,chirp,rx,sample,iq")


def run_cli(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_info:
        main(["inspect", *arguments])
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


def test_recording_is_described_and_plotted(folder, capsys):
    status, out, err = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS, "--json")

    document = json.loads(out)
    assert (status, err) == (0, "")
    assert document["format"] == "npy"
    assert document["dims"] == {"frame": 3, "chirp": 32, "rx": 2, "sample": 64}
    assert document["radar"]["frame"]["n_chirps"] == 32
    assert document["radar"]["derived"]["max_range_m"] == pytest.approx(49.965, rel=1e-4)
    assert [finding["level"] for finding in document["findings"]] == []
    assert json.loads((folder / "dechirp-inspect" / "inspect.json").read_text()) == document
    assert image.imread(folder / "dechirp-inspect" / "map.png").shape[1] == 1560


def test_defects_are_reported_as_text_and_json(folder, capsys):
    samples = make_samples()
    samples[:, :, 1] = 0  # a dead receiver
    samples[0, 5, 0, 10:20] = 32767  # clipped
    np.save("broken.npy", samples)

    _, out, _ = run_cli(capsys, "broken.npy", *RECORDING_OPTIONS)
    _, document, _ = run_cli(capsys, "broken.npy", *RECORDING_OPTIONS, "--json")

    warnings = [f for f in json.loads(document)["findings"] if f["level"] == "warning"]
    assert any("clip" in f["setting"] for f in warnings)
    assert any("receiver 1" in f["value"] for f in warnings)
    assert out.count("warning:") == len(warnings)


def test_known_format_without_axes_reports_axes_option(folder, capsys):
    status, out, _ = run_cli(capsys, "cube.npy", "--radar", "radar.yaml", "--json")

    document = json.loads(out)
    assert status == 1
    assert document["format"] == "npy"
    assert (document["dims"], document["radar"]) == (None, None)
    (finding,) = document["findings"]
    assert finding["level"] == "error"
    assert "--axes" in finding["fix"]
    assert set(document["files"]) == {"inspect.json"}


def test_status_states_whether_samples_can_be_read(folder, capsys):
    clipped = make_samples()
    clipped[0, 5, 0, 10:20] = 32767
    np.save("clipped.npy", clipped)
    Path("cut.npy").write_bytes(Path("cube.npy").read_bytes()[:5000])

    readable = run_cli(capsys, "clipped.npy", *RECORDING_OPTIONS, "--quiet")
    damaged = run_cli(capsys, "cut.npy", *RECORDING_OPTIONS, "--quiet")

    assert readable == (0, "", "")
    assert damaged[:2] == (1, "")
    assert damaged[2].startswith("error: recording: a file of 5000 bytes; expected")


def test_empty_path_is_refused_instead_of_the_current_folder(folder, capsys):
    status, _, err = run_cli(capsys, "", *RECORDING_OPTIONS)

    assert status == 2
    assert err.startswith("command line: an empty argument after inspect; expected a name")
    assert not (folder / "dechirp-inspect").exists()
    for read in (dc.open, dc.inspect):
        with pytest.raises(dc.DechirpError, match="^path: empty; expected the name of a file"):
            read("", radar="radar.yaml", axes="frame,chirp,rx,sample,iq")


def test_unknown_and_missing_files_exit_with_2(folder, capsys):
    (folder / "letter.txt").write_text("Dear reader,\n")

    for name in ("letter.txt", "absent.bin"):
        status, out, _ = run_cli(capsys, name, "--json")

        assert status == 2
        assert set(json.loads(out)) == {"errors"}
    assert not (folder / "dechirp-inspect").exists()


@nightly
def test_point_cloud_is_plotted_from_above(folder, capsys):
    points = struct.pack("<4f", -1.0, 2.0, 0.0, 0.5)
    items = struct.pack("<II", 1, 16) + points
    header = struct.pack("<8I", 0x03060000, 40 + 24, 0xA1843, 7, 0, 1, 1, 0)
    (folder / "stream.dat").write_bytes((bytes.fromhex("0201040306050807") + header + items) * 2)

    status, out, _ = run_cli(capsys, "stream.dat", "--json")

    document = json.loads(out)
    assert (status, document["format"]) == (0, "ti-uart")
    assert document["dims"] == {"frame": 2, "detection": 2}
    assert image.imread(folder / "dechirp-inspect" / "map.png").shape[1] == 1560
    _, out, _ = run_cli(capsys, "stream.dat")
    # Two in all, not a grid of two by two.
    assert re.search(r"frames +2 *\n detections in all frames +2\b", out)


def test_broken_device_rules_are_findings(folder, capsys):
    _, out, _ = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS, "--device", "xwr1642", "--json")

    errors = [f for f in json.loads(out)["findings"] if f["level"] == "error"]
    # 10 MS/s is above the chip's 6.25 MS/s, and its filter ends at 5 MHz.
    assert "radar.frame.chirp.sample_rate" in [finding["setting"] for finding in errors]


def test_frame_rules_apply_only_with_known_period(folder, capsys):
    # Without a period, 300 chirps may be frames of one chirp; with it they are one frame.
    (folder / "many.yaml").write_text(RADAR.replace("n_chirps: 32", "n_chirps: 300"))
    (folder / "framed.yaml").write_text(
        RADAR.replace("n_chirps: 32", "n_chirps: 300\n  period: 12.1 ms")
    )
    np.save(
        "many.npy", np.concatenate([make_samples().reshape(1, 96, 2, 64, 2)] * 4, axis=1)[:, :300]
    )

    settings = {}
    for name in ("many", "framed"):
        options = ("--radar", f"{name}.yaml", *RECORDING_OPTIONS[2:], "--device", "xwr1443")
        _, out, _ = run_cli(capsys, "many.npy", *options, "--json")
        errors = [f for f in json.loads(out)["findings"] if f["level"] == "error"]
        settings[name] = {finding["setting"] for finding in errors}

    frame_settings = {"radar.frame.n_chirps", "radar.frame.period"}
    assert settings["framed"] & frame_settings == frame_settings
    assert not settings["many"] & frame_settings


@pytest.mark.parametrize(
    ("options", "fragment"),
    [
        (("--device", "xwr9999"), "xwr9999"),
        (("--radar", "absent.yaml"), "absent.yaml"),
        (("--radar", "wrong.cfg"), "profileCfg"),
    ],
)
def test_invalid_options_exit_with_2_and_are_named(folder, capsys, options, fragment):
    (folder / "wrong.cfg").write_text("profileCfg 0 77\n")

    status, _, err = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS[2:], *options)

    assert status == 2
    assert fragment in err
    assert not (folder / "dechirp-inspect").exists()


def test_frames_option_selects_frames(folder, capsys):
    _, out, _ = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS, "--frames", "1:3", "--json")

    assert json.loads(out)["dims"]["frame"] == 2


def test_python_function_gives_same_result_as_command(folder):
    inspection = dc.inspect("cube.npy", radar="radar.yaml", axes="frame,chirp,rx,sample,iq")

    assert inspection.formats == ("npy",)
    assert inspection.recording is not None
    assert inspection.power is not None
    assert inspection.power.sizes == {"velocity": 32, "range": 64}
    assert inspection.findings == ()


def test_foreign_folder_is_not_replaced(folder, capsys):
    (folder / "mine").mkdir()
    (folder / "mine" / "thesis.txt").write_text("years of work")

    status, _, err = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS, "--out", "mine")

    assert status == 2
    assert "thesis.txt" in err
    assert (folder / "mine" / "thesis.txt").exists()


@pytest.mark.parametrize(
    "arguments",
    [("--frames", "3:9"), ("--device", "xwr9999"), ("--radar", "absent.yaml")],
)
def test_invalid_call_gives_errors_instead_of_findings(folder, capsys, arguments):
    status, out, _ = run_cli(capsys, "cube.npy", *RECORDING_OPTIONS, *arguments, "--json")

    assert status == 2
    assert set(json.loads(out)) == {"errors"}
    assert not (folder / "dechirp-inspect").exists()


def test_rejects_option_that_format_does_not_accept(folder, capsys):
    (folder / "capture.bin").write_bytes(make_samples().tobytes())

    status, out, _ = run_cli(capsys, "capture.bin", *RECORDING_OPTIONS, "--json")

    assert status == 2
    assert "with axes" in json.loads(out)["errors"][0]["value"]


def test_settings_file_is_not_accepted_as_recording(folder, capsys):
    status, out, _ = run_cli(capsys, "radar.yaml", "--json")

    (error,) = json.loads(out)["errors"]
    assert status == 2
    radar = str(read_radar("radar.yaml"))
    assert radar.startswith("Radar(")
    assert error["value"] == (
        f"the settings of a recording, not its samples: {radar.removeprefix('Radar(')[:-1]}"
    )
    assert "--radar" in error["fix"]
    (folder / "radar.cfg").write_text("profileCfg 0 77\nframeCfg 0 1\n")
    _, out, _ = run_cli(capsys, "radar.cfg", "--json")
    (error,) = json.loads(out)["errors"]
    assert ", and they cannot be read: profileCfg: 2 numbers" in error["value"]


@nightly
def test_inspect_does_not_import_dask(folder):
    """xarray imports Dask, 0.35 s, to compare the type of each array that it wraps."""
    (folder / "dask").mkdir()
    (folder / "dask/__init__.py").write_text("raise SystemExit('dask was imported')")
    path = os.pathsep.join([str(folder), *(entry for entry in sys.path if entry)])
    process = subprocess.run(
        [sys.executable, "-m", "dechirp", "inspect", "cube.npy", *RECORDING_OPTIONS, "--quiet"],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )

    assert (process.returncode, process.stderr) == (0, "")
