"""The command line: what a person types, what a script reads, and every way to be wrong."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config import loading
from dechirp.config.dumping import dump
from dechirp.config.fields import list_settings
from dechirp.core.table_columns import COLUMNS
from dechirp.results import results
from dechirp.results.results import FILES

HEAVY = ["numpy", "scipy", "xarray", "numba", "matplotlib", "pint", "pydantic", "zarr"]

RUN_KEYS = (
    "version seed source radar frames detections clusters tracks truth findings timing_s files"
)
ERROR_KEYS = ["file", "line", "column", "setting", "value", "expected", "fix"]

DESIGN = ["--max-range", "200m", "--range-resolution", "1m"]
FAST = [*DESIGN, "--max-velocity", "60 m/s"]

# 75 m and 27 m/s unambiguous, 0.59 m and 1.7 m/s a bin: a run of it takes no time.
SCENARIO = """\
name: small
seed: 5
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 30 us,
            sample_rate: 10 MHz, n_samples: 128, sampling: complex}
    n_chirps: 32
    interval: 35 us
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: car, position: [30 m, 0 m, 0 m], velocity: [-8 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}
"""
CALL = ["run", "small.yaml", "--json"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """Give a folder to be in, with a scenario."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SCENARIO)
    return tmp_path


@pytest.fixture
def call(capsys):
    """Call the command line, and give its status, standard output and standard error."""

    def called(*words: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main(words)
        return ended.value.code, *capsys.readouterr()

    return called


@pytest.fixture
def refused(call):
    """Call what is wrong: the same mistakes as lines, and as the errors of one document."""

    def called(*words: str) -> list[dict]:
        status, out, err = call(*words)
        assert (status, out) == (2, "")
        assert "Traceback" not in err
        status, out, nothing = call(words[0], "--json", *words[1:])
        assert (status, nothing) == (2, "")
        document = json.loads(out)
        assert list(document) == ["errors"]
        errors = document["errors"]
        assert [list(error) for error in errors] == [ERROR_KEYS] * len(errors)
        for line, error in zip(err.splitlines(), errors, strict=True):
            place = ":".join(str(error[key]) for key in ERROR_KEYS[:3] if error[key] is not None)
            where = f"{place}: {error['setting']}" if place else error["setting"]
            assert (
                line == f"{where}: {error['value']}; expected {error['expected']}; {error['fix']}"
            )
        return errors

    return called


def python(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """Run a process of its own that finds the package as this one does."""
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.run(
        [sys.executable, *words], env=paths, text=True, capture_output=True, check=False, **options
    )


# Starting


def test_help_loads_no_library_of_the_chain():
    script = f"""
import sys
from dechirp.cli.main import main
try:
    main(["--help"])
finally:
    print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""
    ended = python("-c", script)

    assert ended.returncode == 0
    assert ended.stderr == "[]\n"
    assert all(name in ended.stdout for name in ("run", "design", "list", "doctor"))


@pytest.mark.parametrize("command", ["run", "design", "list", "doctor"])
def test_every_command_has_help(call, command):
    status, out, err = call(command, "--help")

    assert (status, err) == (0, "")
    assert f"dechirp {command}" in out


def test_the_version_is_the_packages(call):
    assert call("--version") == (0, f"{dc.__version__}\n", "")


def test_nobody_reading_is_no_error():
    words = [sys.executable, "-m", "dechirp", "list"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    with subprocess.Popen(
        words, env=paths, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b""


needs_full = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="only Linux has a device that is always full"
)
FULL = (
    "standard output: not writable (No space left on device); expected a place that can"
    " be written and has room; redirect it elsewhere\n"
)


def redirected(to: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a process of its own with streams that a shell closes or sends elsewhere."""
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.run(
        ["/bin/sh", "-c", f'exec "$0" "$@" {to}', sys.executable, *words],
        env=paths,
        text=True,
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("to", "printed"), [(">&-", False), ("2>&-", True), ("<&- >&- 2>&-", False)]
)
def test_with_closed_streams_commands_work_all_the_same(folder, to, printed):
    ended = redirected(to, "-m", "dechirp", "run", "small.yaml", "--json")

    assert (ended.returncode, ended.stderr) == (0, "")
    document = (folder / "dechirp-run" / "run.json").read_text()
    assert ended.stdout == (document if printed else "")


def test_a_mistake_does_not_go_to_standard_output_because_standard_error_is_closed():
    ended = redirected("2>&-", "-m", "dechirp", "lst")

    assert (ended.returncode, ended.stdout) == (2, "")


def test_with_standard_output_closed_work_can_be_shared_among_processes(folder):
    script = """
import sys
from dechirp.cli.main import main
try:
    main(["list"])
except SystemExit:
    from loky import get_reusable_executor
    executor = get_reusable_executor(max_workers=1)
    with open("file", "w") as file:  # its number must not be that of standard output
        executor.submit(print, "from a worker").result()
    print(executor.submit(abs, -7).result(), file=sys.stderr)
"""
    ended = redirected(">&-", "-c", script)

    assert (ended.returncode, ended.stderr) == (0, "7\n")
    assert (folder / "file").read_text() == ""


# A text that waits until the end, one that is written at once, and those of other libraries.
@needs_full
@pytest.mark.parametrize("words", [["list", "cfar"], ["run", "--json"], ["--help"], ["--version"]])
def test_a_full_output_is_a_message(words):
    ended = redirected(">/dev/full", "-m", "dechirp", *words)

    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", FULL)


@needs_full
@pytest.mark.parametrize("to", ["2>/dev/full", ">/dev/full 2>/dev/full"])
def test_where_no_message_can_be_written_the_status_tells(to):
    ended = redirected(to, "-m", "dechirp", "lst")

    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", "")


def test_what_fails_but_printing_is_not_called_so(monkeypatch):
    def fail(_words):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("dechirp.cli.main._run_command", fail)

    with pytest.raises(OSError, match="Input/output error"):
        main(["list"])


# A run


def test_without_anything_it_finds_the_car_at_50_m(folder):
    ended = python("-m", "dechirp", "run", cwd=folder)

    assert (ended.returncode, ended.stderr) == (0, "")
    assert "50.0" in ended.stdout
    assert "10.0" in ended.stdout
    assert "dechirp-run/report.html" in ended.stdout
    assert {file.name for file in (folder / "dechirp-run").iterdir()} == set(FILES)


def test_the_document_is_complete_and_also_a_file(call, folder):
    status, out, err = call(*CALL, "--out", "there")

    document = json.loads(out, parse_constant=pytest.fail)
    assert (status, err) == (0, "")
    assert list(document) == RUN_KEYS.split()
    assert out == (folder / "there" / "run.json").read_text()
    assert document["files"] == {name: f"there/{name}" for name in FILES}
    assert document["version"] == dc.__version__
    assert (document["seed"], document["source"], document["frames"]) == (5, "small.yaml", 1)
    assert document["clusters"] is document["tracks"] is None
    [car] = document["truth"]
    assert list(car) == [*COLUMNS, "target"]
    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert list(strongest) == list(COLUMNS)
    # Half a cell; what theory allows is far less, and tested elsewhere.
    limits = document["radar"]["derived"]
    assert strongest["range_m"] == pytest.approx(
        car["range_m"], abs=limits["range_resolution_m"] / 2
    )
    assert strongest["velocity_m_per_s"] == pytest.approx(
        car["velocity_m_per_s"], abs=limits["velocity_resolution_m_per_s"] / 2
    )
    assert document["radar"]["frame"]["chirp"]["start_frequency_hz"] == 77e9


def test_a_seed_gives_the_same_numbers_again(call):
    def detections(*words):
        return json.loads(call(*CALL, *words)[1])["detections"]

    first = detections("--seed", "7")

    assert detections("--set", "seed=7") == first
    assert detections() != first


def test_the_scenario_as_run_gives_the_same_detections(call, folder):
    call("run", "small.yaml", "--seed", "7", "--set", "scene.targets.car.position=[31 m, 0 m, 0 m]")
    before = (folder / "dechirp-run" / "detections.csv").read_text()

    status, _, _ = call("run", "dechirp-run/scenario.yaml", "--out", "again")

    assert status == 0
    assert (folder / "again" / "detections.csv").read_text() == before
    for name in ("again", "dechirp-run"):
        assert dc.load(folder / name / "scenario.yaml").seed == 7


def test_set_changes_any_setting_with_units(call):
    document = json.loads(
        call(*CALL, "--set", "radar.frame.n_chirps=48", "--set", "radar.frame.interval=40 us")[1]
    )

    assert document["radar"]["frame"]["n_chirps"] == 48
    assert document["radar"]["frame"]["interval_s"] == 40e-6


def test_another_radar_takes_the_place_of_the_scenarios(call, folder):
    radar = dc.load("small.yaml", ["radar.frame.n_chirps=64"]).radar
    (folder / "radars").mkdir()
    (folder / "radars" / "long.yaml").write_text(dump(radar))

    document = json.loads(
        call(*CALL, "--radar", "radars/long.yaml", "--set", "radar.frame.interval=40 us")[1]
    )

    assert document["radar"]["frame"]["n_chirps"] == 64
    assert document["radar"]["frame"]["interval_s"] == 40e-6


def test_frames_of_a_scene_are_so_many(call):
    status, out, _ = call("run", "small.yaml", "--frames", "2")

    assert status == 0
    assert " frame " in out
    assert json.loads(Path("dechirp-run/run.json").read_text())["frames"] == 2


def test_a_target_that_is_not_found_is_said(call):
    _, out, _ = call("run", "small.yaml", "--set", "scene.targets.car.rcs=-90 dBsm")

    assert out.startswith("0 detections")
    assert "Not detected: car, at 30.0 m" in out


def test_quiet_prints_nothing(call):
    assert call("run", "small.yaml", "--quiet") == (0, "", "")


def test_an_interrupted_run_says_nothing_and_leaves_the_old_result(call, folder, monkeypatch):
    call("run", "small.yaml")
    before = {file.name: file.stat().st_mtime_ns for file in (folder / "dechirp-run").iterdir()}

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(results, "write_cube", interrupt)

    assert call("run", "small.yaml") == (130, "", "Interrupted; nothing was written.\n")
    after = {file.name: file.stat().st_mtime_ns for file in (folder / "dechirp-run").iterdir()}
    assert after == before
    assert {file.name for file in folder.iterdir()} == {"small.yaml", "dechirp-run"}


# Recordings


@pytest.fixture
def recorded(folder) -> list[str]:
    """Record the small scene, and give the words that read it."""
    scenario = dc.load("small.yaml")
    cube = dc.simulate(scenario.scene, scenario.radar, n_frames=3, seed=5)
    loudest = abs(cube.values.view(np.float32)).max()
    np.save("car.npy", cube.values[:, :, 0] / loudest)
    (folder / "radar.yaml").write_text(dump(scenario.radar))
    return ["run", "car.npy", "--radar", "radar.yaml", "--axes", "frame,chirp,sample"]


def test_a_recording_goes_through_the_same_chain(call, recorded):
    status, out, err = call(*recorded, "--frames", "1:3", "--json")

    document = json.loads(out)
    assert (status, err) == (0, "")
    assert (document["source"], document["frames"], document["truth"]) == ("car.npy", 2, None)
    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert strongest["range_m"] == pytest.approx(30, abs=0.3)
    assert strongest["velocity_m_per_s"] == pytest.approx(-8, abs=0.8)


def test_a_recording_can_be_run_again_from_elsewhere(call, recorded, folder, monkeypatch):
    call(*recorded, "--set", "chain.range_window=hamming")
    before = (folder / "dechirp-run" / "detections.csv").read_text()
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")

    status, _, err = call("run", "../dechirp-run/scenario.yaml")

    assert (status, err) == (0, "")
    assert Path("dechirp-run/detections.csv").read_text() == before
    assert "range_window: hamming" in Path("dechirp-run/scenario.yaml").read_text()


def test_what_is_said_of_a_recording_replaces_what_its_scenario_says(call, recorded, folder):
    (folder / "wrong.yaml").write_text("recording: {path: car.npy, axes: [chirp, frame, sample]}")

    status, _, err = call("run", "wrong.yaml", *recorded[2:])

    assert (status, err) == (0, "")


@pytest.mark.parametrize("given", [["--radar", "radar.yaml"], []])
def test_the_radar_of_a_recording_can_be_changed(call, recorded, given):
    # With --radar, and with the settings beside the recording.
    words = [*recorded[:2], *given, *recorded[4:], "--set", "radar.frame.interval=70 us"]

    document = json.loads(call(*words, "--json")[1])

    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert strongest["velocity_m_per_s"] == pytest.approx(-4, abs=0.8)


def test_settings_that_a_recording_has_no_use_for_are_not_written(call, recorded):
    call(*recorded, "--frames", "1:3")

    written = Path("dechirp-run/scenario.yaml").read_text()
    assert "frames: [1, 3]" in written
    assert "n_frames" not in written
    assert "impairments" not in written


def test_a_map_too_small_for_the_training_cells_of_a_recording_names_the_setting(refused, recorded):
    [error] = refused(*recorded, "--set", "chain.cfar.n_training.velocity=80")

    assert error["setting"] == "chain.cfar.n_training"


def test_the_report_of_later_frames_says_how_far_the_peak_is_over_the_threshold(call, recorded):
    call(*recorded, "--frames", "2:3")

    assert "over the threshold" in Path("dechirp-run/report.html").read_text()


def test_frames_that_a_recording_does_not_have_are_refused(refused, recorded):
    [error] = refused(*recorded, "--frames", "2:4")

    assert error["value"].startswith("of 3 frames")


# Wrong calls


@pytest.mark.parametrize(
    ("words", "setting", "value", "fix"),
    [
        (["rn"], "command", "rn", "did you mean run?"),
        (["run", "--sed", "1"], "--sed", "not an option of this command", "did you mean --seed?"),
        (["run", "--seed", "one"], "--seed", "one", "write digits only"),
        (["run", "--seed", "1.5"], "--seed", "1.5", "write digits only"),
        (["run", "--seed", "-1"], "--seed", "-1", "give a whole number"),
        (["run", "--seed"], "--seed", "no value", "see dechirp run --help"),
        (["run", "--seed=1", "--seed=2"], "--seed", "given twice", "keep one of them"),
        (["run", "--iq", "qq"], "--iq", "qq", "use one of these"),
        (["run", "a.npy", "b.npy"], "command line", "unexpected argument b.npy", "quote names"),
        (["run", "--quiet=yes!"], "--quiet", "yes!", "see dechirp run --help"),
        (["run", "--set", "seed"], "--set", "seed", "write --set"),
        (["run", "--frames", "2:x"], "--frames", "2:x", "count frames from 0"),
        (["run", "--frames", "2:3"], "--frames", "2:3", "count frames from 0"),
        (["run", "--frames", "0"], "--frames", "0", "give a whole number"),
        (["run", "--axes", "chirp,sample"], "--axes", "given for a simulated scene", "remove it"),
        (["run", "--out", "small.yaml"], "--out", "small.yaml, a file", "name a folder"),
        (["run", "--out", "."], "--out", "., the working folder", "name a folder inside"),
        (["run", "--out", "small.yaml/x"], "--out", "small.yaml/x, not writable", "name a wri"),
        (["run", "--out", ".."], "--out", "..", "name a folder inside"),
        (["design", *FAST, "--set", "limts.idle=1us"], "limts", "not a known", "did you mean lim"),
        (["design", *FAST, "--set", "limits.idle=1"], "limits.idle", "1", "units that fit"),
        (["design", *FAST, "--set", "limits.idle=1us"], "--set", "a limit, together", "add --rule"),
        (["list", "cfra"], "FAMILY", "cfra", "did you mean cfar?"),
        (["design", *DESIGN, "--max-velocity", "100"], "--max-velocity", "100", "units that fit"),
        (["design", *DESIGN, "--max-velocity", "-9 m/s"], "--max-velocity", "-9 m/s", "give a"),
        (["design", *DESIGN], "--max-velocity", "missing", "add --max-velocity"),
        (["design", "--rule", "thumb"], "--rule", "thumb", "use one of these"),
    ],
    ids=lambda part: " ".join(part[:3]) if isinstance(part, list) else "",
)
def test_a_wrong_call_says_what_is_needed(refused, words, setting, value, fix):
    [error] = refused(*words)

    assert error["setting"] == setting
    assert error["value"].startswith(value)
    assert error["fix"].startswith(fix)
    assert error["file"] in (None, "--set")
    assert error["file"] is None or "--set" in words


def test_a_command_without_options_offers_none(call):
    need = "not an option of this command; expected no options; see dechirp schema --help"
    assert call("schema", "--pdf") == (2, "", f"--pdf: {need}\n")


@pytest.mark.parametrize("words", [["run", "--seed", "x"], ["run", "--sed", "1"]])
def test_a_script_that_says_json_in_any_way_gets_its_mistakes_as_json(call, words):
    status, out, err = call(*words, "--json=true")

    assert (status, err) == (2, "")
    assert [list(error) for error in json.loads(out)["errors"]] == [ERROR_KEYS]


def test_every_wrong_option_is_told_at_once(refused):
    errors = refused("design", "--max-range", "200", "--range-resolution", "1 s", "--band", "60")

    assert {error["setting"]: error["value"] for error in errors} == {
        "--max-range": "200",
        "--range-resolution": "1 s",
        "--max-velocity": "missing",
        "--band": "60",
    }


# Wrong files


@pytest.mark.parametrize(
    ("old", "new", "line", "setting", "value", "fix"),
    [
        ("n_chirps", "n_chrips", 7, "radar.frame.n_chrips", "not a known", "did you mean n_chirps"),
        ("35 us", "35 ms/s", 8, "radar.frame.interval", "35 ms/s", "did you mean ms?"),
        ("35 us", "35", 8, "radar.frame.interval", "35", "units that fit: s, ms"),
        ("n_chirps: 32", "n_chirps: '32'", 7, "radar.frame.n_chirps", "the text '32'", "write"),
        ("seed: 5", "name: two", 2, "name", "given twice, first on line 1", "keep one"),
        ("n_chirps: 32", "n_chirps: -32", 7, "radar.frame.n_chirps", "-32", "give a whole number"),
        ("n_chirps: 32", "n_chirps: 0", 7, "radar.frame.n_chirps", "0", "give a whole number"),
        ("10 MHz", "-10 MHz", 6, "radar.frame.chirp.sample_rate", "-10 MHz", "give a positive"),
        ("n_samples: 128", "n_samples: 99999999999", 6, "radar.frame.chirp.n_samples", "9999", ""),
        ("small", "[", 1, "the text", "not YAML", "correct it there"),
    ],
    ids=["name", "unit", "no unit", "type", "twice", "negative", "zero", "rate", "absurd", "yaml"],
)
def test_a_mistake_in_a_file_is_pointed_at(refused, folder, old, new, line, setting, value, fix):
    assert old in SCENARIO
    (folder / "wrong.yaml").write_text(SCENARIO.replace(old, new))

    error = refused("run", "wrong.yaml")[0]

    assert error["file"] == "wrong.yaml"
    assert error["setting"] == setting
    assert error["value"].startswith(value)
    assert error["fix"].startswith(fix)
    if setting != "the text":
        assert error["line"] == line
        assert error["column"] >= 1
    assert not (folder / "dechirp-run").exists()


@pytest.mark.parametrize(
    ("old", "new", "line", "setting"),
    [
        ("scene:", "chain: {n_range_bins: 25}\nscene:", 10, "chain.n_range_bins"),
        ("scene:", "chain: {n_velocity_bins: 25}\nscene:", 10, "chain.n_velocity_bins"),
        (
            "scene:",
            "chain: {cfar: {estimator: {kind: cell-averaging},"
            " n_training: {range: 80, velocity: 2},\n  false_alarm_probability: 1e-6}}\nscene:",
            10,
            "chain.cfar.n_training",
        ),
        ("  hardware:", "# hardware:", 3, "radar.hardware"),
        ("[30 m, 0 m, 0 m]", "[0 m, 0 m, 0 m]", 12, "scene.targets.car.position"),
        (
            "scene:",
            "impairments: [{kind: white-noise, snr: -9 dB, target: bus}]\nscene:",
            10,
            "impairments.white-noise.target",
        ),
        (
            "scene:",
            "impairments:\n  - {kind: white-noise, snr: 1 dB}\n"
            "  - {kind: white-noise, snr: 1 dB, target: bus}\nscene:",
            12,
            "impairments.1.target",
        ),
    ],
)
def test_a_mistake_between_settings_is_pointed_at_too(refused, folder, old, new, line, setting):
    assert old in SCENARIO
    (folder / "wrong.yaml").write_text(SCENARIO.replace(old, new))

    [error] = refused("run", "wrong.yaml")

    assert (error["file"], error["line"], error["setting"]) == ("wrong.yaml", line, setting)
    assert error["column"] >= 1


@pytest.mark.parametrize(
    "change",
    [
        "chain.n_range_bins=25",
        "chain.cfar.n_training.velocity=80",
        "scene.targets.car.position=[0 m, 0 m, 0 m]",
    ],
)
def test_a_mistake_between_settings_that_set_makes_is_blamed_on_it(refused, change):
    [error] = refused("run", "small.yaml", "--set", change)

    assert error["file"] == "--set"
    assert change.startswith(error["setting"])


def test_mistakes_of_the_file_and_of_set_come_together(refused, folder):
    (folder / "wrong.yaml").write_text(SCENARIO.replace("12 dBm", "12 dBi"))

    errors = refused("run", "wrong.yaml", "--set", "chain.n_rang_bins=512", "--set", "radar.frme=1")

    found = {(error["file"], error["setting"]) for error in errors}
    assert found == {
        ("wrong.yaml", "radar.hardware.transmit_power"),
        ("--set", "chain.n_rang_bins"),
        ("--set", "radar.frme"),
    }


def test_a_scene_larger_than_memory_is_refused_before_it_starts(refused, folder):
    [error] = refused("run", "small.yaml", "--set", "radar.frame.n_chirps=1000000000")

    # 3 cubes of 1e9 chirps x 128 samples x 8 bytes.
    assert error["value"] == "2.86e+03 GiB of memory"
    assert "GiB, the free memory" in error["expected"]
    assert not (folder / "dechirp-run").exists()


def nan(file):
    np.save(file, np.full((32, 128), np.nan, np.complex64))


@pytest.mark.parametrize(
    ("name", "make", "value"),
    [
        ("none.npy", lambda file: None, "not readable (no such file or folder)"),
        ("empty.npy", lambda file: file.write_bytes(b""), "an empty file"),
        ("text.npy", lambda file: file.write_text("1 2 3"), "text"),
        ("cut.npy", lambda file: file.write_bytes(Path("car.npy").read_bytes()[:5000]), ""),
        ("size.npy", lambda file: np.save(file, np.zeros((32, 127), np.complex64)), ""),
        ("nan.npy", nan, ""),
        ("cut.bin", lambda file: file.write_bytes(bytes(range(256)) * 8), "2048 bytes"),
    ],
    ids=["absent", "empty", "text", "truncated", "other size", "nan", "short bin"],
)
def test_a_recording_that_is_none_is_refused(refused, recorded, folder, name, make, value):
    make(folder / name)
    axes = ["--axes", "chirp,sample"] if name.endswith(".npy") and name != "cut.npy" else []
    axes = recorded[4:] if name == "cut.npy" else axes

    [error] = refused("run", name, "--radar", "radar.yaml", *axes)

    assert error["value"].startswith(value)
    assert not (folder / "dechirp-run").exists()


def test_a_recording_without_a_radar_asks_for_one(refused, recorded, folder):
    (folder / "radar.yaml").unlink()

    [error] = refused("run", "car.npy", *recorded[4:])

    assert error["setting"] == "recording"
    assert "--radar FILE" in error["fix"]


def test_a_setting_of_a_recording_is_not_blamed_on_a_file_that_nobody_wrote(refused, recorded):
    [error] = refused(*recorded, "--set", "chain.cfar.offset=10 dB")

    assert error["file"] is error["line"] is None
    assert error["setting"] == "chain.cfar.false_alarm_probability"


# Design, list, doctor


def test_a_design_says_every_number_with_its_formula(call):
    status, out, err = call("design", *DESIGN, "--max-velocity", "100 m/s", "--json")

    document = json.loads(out, parse_constant=pytest.fail)
    assert (status, err) == (0, "")
    assert list(document) == ["chirp", "frame", "derived", "findings"]
    bandwidth = document["derived"]["bandwidth"]
    assert bandwidth == {"value": 149_896_229.0, "unit": "Hz", "formula": "c / 2 dR"}
    assert document["chirp"]["n_samples"] == 2200
    assert document["frame"]["n_chirps"] == 128
    _, table, _ = call("design", *DESIGN, "--max-velocity", "360 km/h")
    assert "149.896 MHz" in table
    assert "c / 2 dR" in table
    assert all(name.replace("_", " ") in table for name in document["derived"])


@pytest.mark.parametrize("rule", ["round-trips", "constraints"])
def test_a_design_that_cannot_be_had_ends_with_1_and_says_what_gives(call, rule):
    words = ["design", *DESIGN, "--max-velocity", "500 m/s", "--rule", rule]

    status, out, _ = call(*words)

    assert status == 1
    assert "error: requirements." in out
    status, out, _ = call(*words, "--json")
    assert status == 1
    assert json.loads(out)["findings"][0]["level"] == "error"


def test_options_replace_what_the_file_of_requirements_says(call, refused, folder):
    (folder / "asked.yaml").write_text(
        "{max_range: 100 m, range_resolution: 1 m, max_velocity: 50 m/s, carier: 77 GHz}"
    )
    errors = refused("design", "asked.yaml", "--max-range", "5")
    places = [(error["file"], error["setting"], error["column"]) for error in errors]
    assert places == [("asked.yaml", "carier", 65), (None, "--max-range", None)]

    text = (folder / "asked.yaml").read_text().replace("carier", "carrier")
    (folder / "asked.yaml").write_text(text)
    _, out, _ = call("design", "asked.yaml", "--max-range", "200 m", "--json")
    assert json.loads(out)["chirp"]["n_samples"] == 2200


def test_a_design_takes_other_limits_hardware_and_requirements(call):
    words = ["design", *FAST, "--rule", "constraints", "--json"]

    def made(*changes):
        status, out, err = call(*words, *(word for c in changes for word in ("--set", c)))
        assert (status, err) == (0, "")
        return json.loads(out)

    usual, quick = made(), made("limits.idle=1us")
    # The ramp takes the time that the fly-back leaves.
    assert quick["chirp"]["ramp_duration_s"] > usual["chirp"]["ramp_duration_s"]
    assert made("requirements.max_range=100 m")["chirp"]["n_samples"] < 150
    # 60 dBm leaves the antenna, above what the usual limits allow.
    strong = "hardware.transmit_power=50dBm"
    status, out, _ = call(*words, "--set", strong)
    assert status == 1
    assert "hardware.transmit_power" in [one["setting"] for one in json.loads(out)["findings"]]
    made(strong, "limits.max_peak_eirp=70dBm", "limits.max_mean_eirp=70dBm")


def test_a_design_is_the_radar_of_a_run(call, folder):
    status, _, _ = call(
        "design", *DESIGN, "--max-velocity", "30 m/s", "--rule=constraints", "--out", "made.yaml"
    )
    assert status == 0

    status, out, _ = call(*CALL, "--radar", "made.yaml")

    made = loading.read_settings(folder / "made.yaml", dc.Radar)
    assert status == 0
    assert json.loads(out)["radar"]["frame"]["interval_s"] == made.frame.interval_s


def test_every_requirement_is_an_option(call):
    _, out, _ = call("design", "--help")

    assert all(f"--{name.replace('_', '-')}" in out for name in list_settings(dc.Requirements))


def test_every_family_lists_its_members_with_their_settings(call):
    status, out, err = call("list", "--json")

    families = json.loads(out)["families"]
    assert (status, err) == (0, "")
    assert " ".join(families) == (
        "angle body cfar device format impairment mitigation modulation multiplexing pattern score"
        " writer"
    )
    assert (
        families["multiplexing"]["tdm"]["settings"]["order"]["expected"]
        == "a list, each a whole number"
    )
    assert {"dca1000", "infineon", "npy", "pcap", "ti-uart"} <= set(families["format"])
    snr = families["impairment"]["white-noise"]["settings"]["snr"]
    assert snr["required"]
    assert snr["default"] is None
    assert snr["expected"] == "a ratio, as 4 or 6 dB"
    assert "Echo power over noise power" in snr["help"]
    assert all(member["help"] for members in families.values() for member in members.values())


def test_one_family_can_be_asked_for(call):
    status, out, _ = call("list", "impairment")

    assert status == 0
    assert "white-noise" in out
    assert "cell-averaging" not in out


@pytest.fixture
def installed(folder, monkeypatch):
    """Make it look as if the package had been installed with these requirements."""

    def with_requirements(*lines: str) -> None:
        about = folder / "dechirp-0.dist-info"
        about.mkdir()
        named = "".join(f"Requires-Dist: {line}\n" for line in lines)
        (about / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: dechirp\nVersion: 0\n{named}"
        )
        monkeypatch.syspath_prepend(folder)

    return with_requirements


def test_the_doctor_finds_what_is_there_and_that_kernels_work(call, installed):
    installed("numpy>=2.0", 'pytest>=8; extra == "dev"', "no-such-thing; extra == 'web'")

    status, out, _ = call("doctor", "--json")

    document = json.loads(out)
    assert status == 0
    assert document["dependencies"] == {"numpy": np.__version__}
    assert document["extras"] == {
        "dev": {"pytest": pytest.__version__},
        "web": {"no-such-thing": None},
    }
    assert "simd_range_doppler.transform_chirps" in document["kernels"]
    assert document["problem"] is None
    assert document["cores"] >= document["threads"] >= 1
    assert document["free_memory_bytes"] > 0
    _, table, _ = call("doctor")
    assert "without no-such-thing" in table
    assert "complete" in table


def test_the_doctor_ends_with_1_where_something_is_missing(call, installed):
    installed("no-such-thing>=1")

    status, out, _ = call("doctor")

    assert status == 1
    assert "missing" in out
