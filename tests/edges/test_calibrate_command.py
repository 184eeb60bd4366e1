"""`dechirp calibrate`, the file that it writes, and where that is read."""

import json

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.recordings.settings.calibration import format_calibration, read_calibration
from dechirp.recordings.settings.read import read_radar

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
OPTIONS = ("--radar", "radar.yaml", "--axes", "frame,chirp,rx,sample")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Reflectors at 25 and -40 degrees, 12 m away, before receivers of unlike phase."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "radar.yaml").write_text(RADAR)
    radar = read_radar("radar.yaml")
    unlike = dc.impairments.ChannelMismatch(gains=(1.0,) * 4, phases_rad=PHASES)
    for name, azimuth_deg in (("left", 25.0), ("right", -40.0)):
        towards = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0])
        scene = dc.Scene(targets=[dc.Target(position_m=tuple(12 * towards), rcs_m2=1.0)])
        cube = dc.simulate(
            scene, radar, impairments=[unlike, dc.impairments.ThermalNoise()], seed=1
        )
        np.save(f"{name}.npy", cube.values / abs(cube.values).max())
    return tmp_path


def call(capsys, *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([*words])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


LEFT = ("calibrate", "left.npy", "--azimuth", "25 deg", "--range", "12 m", *OPTIONS)


def test_a_calibration_is_measured_written_and_shown(folder, capsys):
    status, out, err = call(capsys, *LEFT, "--out", "cal.json", "--json")

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
    turned = np.array([row["phase_deg"] for row in rows]) + np.degrees(np.tile(PHASES, 2))
    assert np.ptp(turned) < 8 * max(row["phase_std_deg"] for row in rows)
    assert document["files"] == {"calibration": "cal.json"}

    _, table, _ = call(capsys, *LEFT, "--out", "cal.json")
    assert "8 elements" in table
    assert "Residual" in table


def test_several_recordings_have_an_angle_each_in_their_order(folder, capsys):
    words = ("calibrate", "left.npy", "--azimuth", "25 deg", "right.npy", "--azimuth", "-40 deg")

    status, out, _ = call(capsys, *words, *OPTIONS, "--json")

    document = json.loads(out)
    assert status == 0
    assert document["range_m"] == pytest.approx([12, 12], abs=0.02)
    assert np.abs(document["calibration"]["position_error_m"]).max() < 2e-5
    assert document["findings"] == []
    assert read_calibration("calibration.json").residual < 0.05


def test_the_calibration_mends_the_angles_of_a_run(folder, capsys):
    call(capsys, *LEFT, "--out", "cal.json")
    found = {}
    for name, extra in (("before", ()), ("after", ("--calibration", "cal.json"))):
        words = ("run", "right.npy", *OPTIONS, *extra, "--out", name, "--json")
        status, out, _ = call(capsys, *words)
        assert status == 0
        rows = json.loads(out)["detections"]
        found[name] = max(rows, key=lambda row: row["snr_db"])

    assert abs(found["before"]["azimuth_deg"] + 40) > 1.0
    row = found["after"]
    assert abs(row["azimuth_deg"] + 40) < max(6 * row["azimuth_std_deg"], 0.1)
    # What ran can run again: the calibration is part of the scenario.
    _, again, _ = call(capsys, "run", "after/scenario.yaml", "--out", "again", "--json")
    assert max(json.loads(again)["detections"], key=lambda row: row["snr_db"]) == row


def test_settings_name_the_file_or_hold_the_calibration(folder, capsys):
    call(capsys, *LEFT, "--out", "cal.json")
    (folder / "sub").mkdir()
    (folder / "cal.json").rename(folder / "sub" / "cal.json")
    expected = read_calibration("sub/cal.json")
    (folder / "sub" / "radar.yaml").write_text(RADAR + "calibration: cal.json\n")
    (folder / "inline.yaml").write_text(RADAR + inline(expected))

    assert read_radar("sub/radar.yaml").calibration == expected
    assert read_radar("inline.yaml").calibration == expected
    opened = dc.open("left.npy", radar="radar.yaml", axes="frame,chirp,rx,sample",
                     calibration="sub/cal.json")  # fmt: skip
    assert opened.radar.calibration == expected
    seen = dc.inspect("left.npy", radar="sub/radar.yaml", axes="frame,chirp,rx,sample")
    assert seen.recording.radar.calibration == expected
    (folder / "sub" / "scenario.yaml").write_text(
        "radar: radar.yaml\nscene: {targets: [{position: [20 m, 0, 0]}]}\n"
    )
    assert dc.load("sub/scenario.yaml").radar.calibration == expected


def inline(calibration: dc.Calibration) -> str:
    return (
        f"calibration: {{elements: {[list(e) for e in calibration.elements]},"
        f" gain: {[list(g) for g in calibration.gain]},"
        f" range_offset: {calibration.range_offset_m!r} m, residual: {calibration.residual!r}}}\n"
    )


def test_a_file_reads_back_equal(tmp_path):
    rng = np.random.default_rng(1)
    for places in (None, [tuple(row) for row in rng.normal(0, 1e-4, (3, 3))]):
        calibration = dc.Calibration(
            elements=[(1, 0), (0, 0), (2, 0)],
            gain=[tuple(row) for row in rng.normal(size=(3, 2))],
            position_error_m=places,
            range_offset_m=rng.normal(),
            residual=None if places is None else 0.1,
        )
        (tmp_path / "cal.json").write_text(format_calibration(calibration))
        assert read_calibration(tmp_path / "cal.json") == calibration


def test_a_store_keeps_the_calibration(folder, capsys):
    call(capsys, *LEFT, "--out", "cal.json")
    expected = read_calibration("cal.json")
    words = ("run", "left.npy", *OPTIONS, "--calibration", "cal.json", "--out", "results")
    call(capsys, *words, "--quiet")

    assert dc.open("results").radar.calibration == expected
    group = xr.open_zarr("results/cube.zarr", group="calibration", consolidated=False)
    kept = np.array(expected.gain) @ np.array([1, 1j])
    np.testing.assert_array_equal(group.gain.values, kept)
    assert list(zip(group.tx.values, group.rx.values, strict=True)) == list(expected.elements)
    assert group.attrs["range_offset_m"] == expected.range_offset_m


RIGHT = {"elements": [[0, 0], [0, 1]], "gain": [[1.0, 0.0], [0.5, 0.5]]}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "the file: not JSON from line 1"),
        ("[1]", "the file: JSON of a list"),
        ("\xff", "the file: not JSON"),
        ("[" * 100_000, "the file: not JSON"),
        (json.dumps({**RIGHT, "gains": []}), "gains: an unknown key"),
        (json.dumps({"gain": RIGHT["gain"]}), "elements: absent"),
        (json.dumps({**RIGHT, "gain": [[1.0, 0.0]]}), "gain: a list of 1"),
        (json.dumps({**RIGHT, "gain": [[1.0, 0.0], ["a", 0]]}), "gain.1: 'a'"),
        (json.dumps({**RIGHT, "gain": None}), "gain: None"),
        (json.dumps({**RIGHT, "residual": float("nan")}), "residual: nan"),
        (json.dumps({**RIGHT, "elements": [[0, 0], [0, 0.5]]}), "elements.1: 0.5"),
        (json.dumps({**RIGHT, "position_error_m": "here"}), "position_error_m: here"),
        (json.dumps(RIGHT), "none for [0, 2]"),
        (json.dumps({**RIGHT, "gain": {"a": 1}}), "gain: {'a': 1}; expected a list"),
        (json.dumps({**RIGHT, "elements": {"0": 0}}), "elements: {'0': 0}; expected a list"),
        (json.dumps({**RIGHT, "gain": [[10**400, 0], [1, 0]]}), "000...; expected one finite"),
        (json.dumps({**RIGHT, "gain": [[0.0, 0.0], [1, 0]]}), "magnitude from 1e-6 to 1e6"),
        (json.dumps({"elements": [], "gain": []}), "elements: []; expected a list of pairs"),
    ],
)
def test_a_damaged_file_is_refused_with_its_name_and_key(folder, capsys, content, words):
    (folder / "cal.json").write_bytes(content.encode("latin-1"))

    status, _, err = call(capsys, "run", "left.npy", *OPTIONS, "--calibration", "cal.json")

    assert status == 2
    assert words in err
    assert "Traceback" not in err
    assert "cal.json" in err or "Radar.calibration" in err


WRONG = {
    "--azimuth: absent": ("left.npy",),
    "left.npy, given twice": ("left.npy", "left.npy", "--azimuth", "0", "--azimuth", "0"),
    "--range: -3.0": ("left.npy", "--azimuth", "0", "--range", "-3 m"),
    "--azimuth: nan deg": ("left.npy", "--azimuth", "nan deg"),
    "gone.json: the file: not there": (
        *("left.npy", "--azimuth", "0", "--calibration", "gone.json"),
    ),
    "RECORDING: absent": ("--azimuth", "25 deg"),
    "one azimuth for each of the 2": ("left.npy", "right.npy", "--azimuth", "25 deg"),
    "--azimuth: 25; expected an angle": ("left.npy", "--azimuth", "25"),
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


@pytest.mark.parametrize(("words", "options"), WRONG.items())
def test_a_wrong_call_says_what_is_wrong(folder, capsys, words, options):
    status, out, err = call(capsys, "calibrate", *options, *OPTIONS)
    as_json = call(capsys, "calibrate", *options, *OPTIONS, "--json")

    assert (status, out) == (2, "")
    assert words in err
    assert as_json[0] == 2
    assert set(json.loads(as_json[1])["errors"][0]) >= {"setting", "value", "expected", "fix"}
    assert (folder / "radar.yaml").read_text() == RADAR


def test_recordings_of_another_radar_are_refused(folder, capsys):
    (folder / "left.yaml").write_text(RADAR)
    (folder / "right.yaml").write_text(RADAR.replace("slope: 20", "slope: 19"))
    (folder / "radar.yaml").unlink()
    words = ("calibrate", "left.npy", "right.npy", "--azimuth", "0", "--azimuth", "0")

    status, _, err = call(capsys, *words, "--axes", "frame,chirp,rx,sample")

    assert status == 2
    assert "radar or waveform different from left.npy" in err


def test_a_simulated_scene_takes_its_calibration_by_its_setting(folder, capsys):
    call(capsys, *LEFT, "--out", "cal.json")
    (folder / "scenario.yaml").write_text(
        "radar: radar.yaml\nscene: {targets: [{position: [20 m, 0, 0]}]}\n"
    )

    status, _, err = call(capsys, "run", "scenario.yaml", "--calibration", "cal.json")
    assert (status, "--calibration: given for a simulated scene" in err) == (2, True)

    setting = ("--set", "radar.calibration=cal.json", "--quiet")
    assert call(capsys, "run", "scenario.yaml", *setting)[0] == 0


def test_a_calibration_to_an_array_that_no_file_gives_says_so(folder, capsys):
    """Phases are measured against the places of the elements: the wrong ones go into them."""
    bare = RADAR[: RADAR.index("  multiplexing")].replace("n_chirps: 16", "n_chirps: 32")
    (folder / "bare.yaml").write_text(bare)
    words = ("calibrate", "left.npy", "--azimuth", "25 deg", "--radar", "bare.yaml")

    status, out, _ = call(capsys, *words, "--axes", "frame,chirp,rx,sample", "--json")

    found = json.loads(out)["findings"]
    assert status == 0
    assert [one["level"] for one in found if one["setting"] == "radar.array.rx"] == ["warning"]
    assert any("--device" in one["fix"] for one in found)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("chain.angle=fft", "write {kind: fft}"),
        ("chain.angle=[]", "an empty list; expected a mapping with kind"),
        ("chain.angle={kind: mus}", "did you mean music?"),
        ("chain.angle={kind: music, n_sources: 99}", "fewer than the 8 elements"),
        ("chain.angle={kind: capon, loading: .nan}", "expected a ratio"),
        ("chain.angle={kind: monopulse, n_sources: 2}", "expected 1, since"),
        ("chain.field_of_view={azimuth: 100 deg}", "(90 deg)"),
        ("chain.field_of_view={azimuth: [-30 deg, 30 deg]}", "write one number"),
        ("radar.calibration={elements: [], gain: []}", "a list of pairs"),
        ("radar.calibration={gain: 3}", "elements: missing"),
        ("radar.calibration=gone.json", "the file: not there"),
    ],
)
def test_wrong_settings_of_directions_and_calibration_name_the_setting(
    folder, capsys, setting, words
):
    status, out, err = call(capsys, "run", "left.npy", *OPTIONS, "--set", setting)

    assert (status, out) == (2, "")
    assert words in err and "Traceback" not in err
    assert setting.partition("=")[0] in err or "gone.json" in err


def test_a_field_of_view_of_one_beam_is_drawn(folder, capsys):
    setting = ("--set", "chain.field_of_view={azimuth: 0.5 deg}", "--quiet")
    assert call(capsys, "run", "left.npy", *OPTIONS, *setting) == (0, "", "")
