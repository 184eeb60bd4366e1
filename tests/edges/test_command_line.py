"""Command line: start-up, runs, recordings, invalid calls and files, design, list and doctor."""

import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import dechirp as dc
from dechirp.cli import commands
from dechirp.cli.commands.list import family_base_classes
from dechirp.cli.console import finding_paragraphs, open_stdout_console, short_finding_paragraphs
from dechirp.cli.main import main
from dechirp.config import loading
from dechirp.config.dumping import dump_yaml
from dechirp.config.fields import list_settings
from dechirp.core.compiled_kernels import compilation_listeners
from dechirp.core.findings import Finding
from dechirp.core.table_columns import COLUMNS
from dechirp.experiments.vital_signs import add_vital_signs
from dechirp.results import results
from dechirp.results.results import FILES
from nightly import nightly, nightly_except

pytestmark = pytest.mark.usefixtures("without_figures")


COMMAND_NAMES = sorted(
    path.stem.replace("_", "-") for path in Path(commands.__path__[0]).glob("[a-z]*.py")
)

HEAVY_LIBRARIES = ["numpy", "scipy", "xarray", "numba", "matplotlib", "pint", "pydantic", "zarr"]

RUN_KEYS = (
    "version seed source radar frames detections clusters tracks truth findings timing_s files"
)
ERROR_KEYS = ["file", "line", "column", "setting", "value", "expected", "fix"]

RANGE_REQUIREMENTS = ["--max-range", "200m", "--range-resolution", "1m"]
ALL_REQUIREMENTS = [*RANGE_REQUIREMENTS, "--max-velocity", "60 m/s"]

# 75 m and 27 m/s unambiguous, 0.59 m and 1.7 m/s per bin: small, so that runs are fast.
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
RUN_AS_JSON = ["run", "small.yaml", "--json"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """Create a working folder with a scenario."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SCENARIO)
    return tmp_path


@pytest.fixture
def run_cli(capsys):
    """Return a function that runs the command line and returns status, stdout and stderr."""

    def run(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as exit_info:
            main(arguments)
        return exit_info.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def collect_errors(run_cli, monkeypatch):
    """Return a function that runs an invalid call as text and as JSON, and returns its errors."""
    # Both messages name the free memory, which other processes change between the calls.
    memory = psutil.virtual_memory()
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)

    def run_twice(*arguments: str) -> list[dict]:
        status, out, err = run_cli(*arguments)
        assert (status, out) == (2, "")
        assert "Traceback" not in err
        status, out, stderr = run_cli(arguments[0], "--json", *arguments[1:])
        assert (status, stderr) == (2, "")
        document = json.loads(out)
        assert list(document) == ["errors"]
        errors = document["errors"]
        assert [list(error) for error in errors] == [ERROR_KEYS] * len(errors)
        for line, error in zip(err.splitlines(), errors, strict=True):
            location = ":".join(str(error[key]) for key in ERROR_KEYS[:3] if error[key] is not None)
            prefix = ": ".join(dict.fromkeys(filter(None, (location, error["setting"]))))
            assert (
                line == f"{prefix}: {error['value']}; expected {error['expected']}; {error['fix']}"
            )
        return errors

    return run_twice


def run_python(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    """Run Python in a new process with the module path of this one."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        text=True,
        capture_output=True,
        check=False,
        **options,
    )


# Start-up and standard streams


def test_help_imports_no_heavy_library():
    script = f"""
import sys
from dechirp.cli.console import finding_paragraphs, open_stdout_console
from dechirp.cli.main import main
try:
    main(["--help"])
finally:
    print([name for name in {HEAVY_LIBRARIES} if name in sys.modules], file=sys.stderr)
"""
    process = run_python("-c", script)

    assert process.returncode == 0
    assert process.stderr == "[]\n"
    assert all(name in process.stdout for name in ("run", "design", "list", "doctor"))


@pytest.mark.parametrize("command", COMMAND_NAMES)
def test_every_command_has_help(run_cli, command):
    status, out, err = run_cli(command, "--help")

    assert (status, err) == (0, "")
    assert f"dechirp {command}" in out


@pytest.mark.parametrize("command", COMMAND_NAMES)
def test_help_breaks_no_line_within_a_sentence(run_cli, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "1000")
    _, out, _ = run_cli(command, "--help")

    rows = [line[1:12] for line in out.splitlines() if line.startswith("│")]
    assert rows
    assert all(row.strip() for row in rows)


def test_help_of_a_command_has_its_whole_description(run_cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "1000")
    _, out, _ = run_cli("inspect", "--help")

    assert "Describe a recording, the limits of its radar and its faults." in out
    assert "The exit status is 0 if its samples or points can be read" in out


def test_version_option_prints_package_version(run_cli):
    assert run_cli("--version") == (0, f"{dc.__version__}\n", "")


def test_closed_output_pipe_causes_no_error():
    arguments = [sys.executable, "-m", "dechirp", "completion", "bash"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    with subprocess.Popen(
        arguments, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b""


needs_dev_full = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="/dev/full exists on Linux only"
)
FULL_OUTPUT_MESSAGE = (
    "standard output: not writable (No space left on device); expected a place that can"
    " be written and has room; redirect it elsewhere\n"
)


def run_redirected(redirection: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a new process whose streams a shell closes or redirects."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.run(
        ["/bin/sh", "-c", f'exec "$0" "$@" {redirection}', sys.executable, *arguments],
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )


@nightly
@pytest.mark.parametrize(
    ("redirection", "is_printed"), [(">&-", False), ("2>&-", True), ("<&- >&- 2>&-", False)]
)
def test_run_succeeds_with_closed_standard_streams(folder, redirection, is_printed):
    process = run_redirected(redirection, "-m", "dechirp", "run", "small.yaml", "--json")

    assert (process.returncode, process.stderr) == (0, "")
    document = (folder / "dechirp-run" / "run.json").read_text()
    assert process.stdout == (document if is_printed else "")


def test_error_stays_off_standard_output_when_standard_error_is_closed():
    process = run_redirected("2>&-", "-m", "dechirp", "lst")

    assert (process.returncode, process.stdout) == (2, "")


@nightly
def test_worker_processes_work_with_closed_standard_output(folder):
    script = """
import sys
from dechirp.cli.console import finding_paragraphs, open_stdout_console
from dechirp.cli.main import main
try:
    main(["list"])
except SystemExit:
    from loky import get_reusable_executor
    executor = get_reusable_executor(max_workers=1)
    with open("file", "w") as file:  # its descriptor must differ from that of standard output
        executor.submit(print, "from a worker").result()
    print(executor.submit(abs, -7).result(), file=sys.stderr)
"""
    process = run_redirected(">&-", "-c", script)

    assert (process.returncode, process.stderr) == (0, "7\n")
    assert (folder / "file").read_text() == ""


# Buffered output, immediate output, and output of other libraries.
@needs_dev_full
@pytest.mark.parametrize(
    "arguments",
    nightly_except(
        [["completion", "bash"], ["--help"]],
        [["completion", "bash"], ["list", "cfar"], ["run", "--json"], ["--help"], ["--version"]],
    ),
)
def test_full_output_device_gives_message(arguments):
    process = run_redirected(">/dev/full", "-m", "dechirp", *arguments)

    # From Python 3.14 on, an empty line on standard error shows that it can be written.
    message = process.stderr.removeprefix("\n")
    assert (process.returncode, process.stdout, message) == (2, "", FULL_OUTPUT_MESSAGE)


@needs_dev_full
@pytest.mark.parametrize(
    "redirection", nightly_except(1, ["2>/dev/full", ">/dev/full 2>/dev/full"])
)
def test_full_standard_error_keeps_exit_status(redirection):
    process = run_redirected(redirection, "-m", "dechirp", "lst")

    assert (process.returncode, process.stdout, process.stderr) == (2, "", "")


def test_other_os_errors_are_not_reported_as_output_errors(monkeypatch):
    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("dechirp.cli.main._run_command", fail)

    with pytest.raises(OSError, match="Input/output error"):
        main(["list"])


# Runs


def test_json_document_is_complete_and_equals_run_json(run_cli, folder):
    status, out, err = run_cli(*RUN_AS_JSON, "--out", "there")

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
    # Half a cell; the theoretical error is far smaller, and tested elsewhere.
    limits = document["radar"]["derived"]
    assert strongest["range_m"] == pytest.approx(
        car["range_m"], abs=limits["range_resolution_m"] / 2
    )
    assert strongest["velocity_m_per_s"] == pytest.approx(
        car["velocity_m_per_s"], abs=limits["velocity_resolution_m_per_s"] / 2
    )
    assert document["radar"]["frame"]["chirp"]["start_frequency_hz"] == 77e9


@nightly
def test_same_seed_gives_same_detections(run_cli):
    def run_detections(*arguments):
        return json.loads(run_cli(*RUN_AS_JSON, *arguments)[1])["detections"]

    first_rows = run_detections("--seed", "7")

    assert run_detections("--set", "seed=7") == first_rows
    assert run_detections() != first_rows


def test_written_scenario_reproduces_detections(run_cli, folder):
    run_cli(
        "run", "small.yaml", "--seed", "7", "--set", "scene.targets.car.position=[31 m, 0 m, 0 m]"
    )
    first_detections = (folder / "dechirp-run" / "detections.csv").read_text()

    status, _, _ = run_cli("run", "dechirp-run/scenario.yaml", "--out", "again")

    assert status == 0
    assert (folder / "again" / "detections.csv").read_text() == first_detections
    for name in ("again", "dechirp-run"):
        assert dc.load(folder / name / "scenario.yaml").seed == 7


def test_set_option_changes_settings_with_units(run_cli):
    document = json.loads(
        run_cli(
            *RUN_AS_JSON, "--set", "radar.frame.n_chirps=48", "--set", "radar.frame.interval=40 us"
        )[1]
    )

    assert document["radar"]["frame"]["n_chirps"] == 48
    assert document["radar"]["frame"]["interval_s"] == 40e-6


def test_radar_option_replaces_radar_of_scenario(run_cli, folder):
    radar = dc.load("small.yaml", ["radar.frame.n_chirps=64"]).radar
    (folder / "radars").mkdir()
    (folder / "radars" / "long.yaml").write_text(dump_yaml(radar))

    document = json.loads(
        run_cli(*RUN_AS_JSON, "--radar", "radars/long.yaml", "--set", "radar.frame.interval=40 us")[
            1
        ]
    )

    assert document["radar"]["frame"]["n_chirps"] == 64
    assert document["radar"]["frame"]["interval_s"] == 40e-6


def test_frames_option_sets_number_of_simulated_frames(run_cli):
    status, out, _ = run_cli("run", "small.yaml", "--frames", "2")

    assert status == 0
    assert " frame " in out
    assert json.loads(Path("dechirp-run/run.json").read_text())["frames"] == 2


def test_missed_target_is_reported(run_cli):
    _, out, _ = run_cli("run", "small.yaml", "--set", "scene.targets.car.rcs=-90 dBsm")

    assert out.startswith("0 detections")
    assert "Not detected: car, at 30.0 m" in out


def test_statistical_option_names_itself_without_traffic(run_cli):
    status, _, err = run_cli("run", "small.yaml", "--statistical")
    assert status == 2
    assert " ".join(err.split()).startswith("--statistical: given without traffic; expected a ")


def test_quiet_option_prints_nothing(run_cli):
    assert run_cli("run", "small.yaml", "--quiet") == (0, "", "")


@pytest.mark.parametrize(("options", "n_lines"), [((), 1), (("--json",), 1), (("--quiet",), 0)])
def test_compilation_is_announced_once_in_redirected_streams(
    run_cli, folder, monkeypatch, options, n_lines
):
    def compile_loops(*_, **__) -> None:
        for listener in compilation_listeners * 2:
            listener.start_compilation()
            listener.end_compilation()

    monkeypatch.setattr("dechirp.cli.compilation_notice.MIN_NOTED_S", 0.0)
    monkeypatch.setattr(results, "check_results_folder_replaceable", compile_loops)

    _, out, err = run_cli("run", "small.yaml", *options)

    assert err.count("Compiling loops") == err.count("\n") == n_lines
    assert "Compiling" not in out


def test_interrupt_after_results_are_in_place_names_them(run_cli, folder, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("dechirp.cli.commands.run.print_run_results", interrupt)

    assert run_cli("run", "small.yaml") == (130, "", "Interrupted; complete: dechirp-run.\n")
    assert (folder / "dechirp-run" / "report.html").is_file()


def test_interrupted_run_writes_nothing_and_keeps_old_result(run_cli, folder, monkeypatch):
    run_cli("run", "small.yaml")
    old_times_ns = {
        file.name: file.stat().st_mtime_ns for file in (folder / "dechirp-run").iterdir()
    }

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(results, "write_cube_store", interrupt)

    assert run_cli("run", "small.yaml") == (130, "", "Interrupted; nothing was written.\n")
    new_times_ns = {
        file.name: file.stat().st_mtime_ns for file in (folder / "dechirp-run").iterdir()
    }
    assert new_times_ns == old_times_ns
    assert {file.name for file in folder.iterdir()} == {"small.yaml", "dechirp-run"}


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("number", nightly_except(1, [signal.SIGINT, signal.SIGTERM]))
@pytest.mark.parametrize("library_fails", [True, False])
def test_signal_in_callback_of_library_ends_command(
    run_cli, folder, monkeypatch, number, library_fails
):
    @ctypes.CFUNCTYPE(None)
    def call_back() -> None:  # as LLVM does while Numba compiles; its exceptions are lost
        signal.raise_signal(number)

    def compile_loop(*_, **__):
        call_back()
        if library_fails:
            raise RuntimeError("no compiled object yet")
        time.sleep(60)

    monkeypatch.setattr(results, "write_cube_store", compile_loop)
    # Background processes of a shell ignore SIGINT.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, out, err = run_cli("run", "small.yaml")
    finally:
        signal.signal(signal.SIGINT, handler)

    assert (status, out, err) == (128 + number, "", "Interrupted; nothing was written.\n")
    assert {file.name for file in folder.iterdir()} == {"small.yaml"}


# Recordings


@pytest.fixture
def recording_arguments(folder) -> list[str]:
    """Record the small scene, and return the arguments that read it."""
    scenario = dc.load("small.yaml")
    cube = dc.simulate(scenario.scene, scenario.radar, n_frames=3, seed=5)
    peak = abs(cube.values.view(np.float32)).max()
    np.save("car.npy", cube.values[:, :, 0] / peak)
    (folder / "radar.yaml").write_text(dump_yaml(scenario.radar))
    return ["run", "car.npy", "--radar", "radar.yaml", "--axes", "frame,chirp,sample"]


def test_recording_is_processed_by_same_chain(run_cli, recording_arguments):
    status, out, err = run_cli(*recording_arguments, "--frames", "1:3", "--json")

    document = json.loads(out)
    assert (status, err) == (0, "")
    assert (document["source"], document["frames"], document["truth"]) == ("car.npy", 2, None)
    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert strongest["range_m"] == pytest.approx(30, abs=0.3)
    assert strongest["velocity_m_per_s"] == pytest.approx(-8, abs=0.8)


@nightly
def test_written_scenario_of_recording_runs_from_other_folder(
    run_cli, recording_arguments, folder, monkeypatch
):
    run_cli(*recording_arguments, "--set", "chain.range_window=hamming")
    first_detections = (folder / "dechirp-run" / "detections.csv").read_text()
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")

    status, _, err = run_cli("run", "../dechirp-run/scenario.yaml")

    assert (status, err) == (0, "")
    assert Path("dechirp-run/detections.csv").read_text() == first_detections
    assert "range_window: hamming" in Path("dechirp-run/scenario.yaml").read_text()


def test_recording_options_override_scenario(run_cli, recording_arguments, folder):
    (folder / "wrong.yaml").write_text("recording: {path: car.npy, axes: [chirp, frame, sample]}")

    status, _, err = run_cli("run", "wrong.yaml", *recording_arguments[2:])

    assert (status, err) == (0, "")


@pytest.mark.parametrize("radar_option", nightly_except(1, [["--radar", "radar.yaml"], []]))
def test_set_option_changes_radar_of_recording(run_cli, recording_arguments, radar_option):
    # Radar settings given by option, and by the file next to the recording.
    arguments = [
        *recording_arguments[:2],
        *radar_option,
        *recording_arguments[4:],
        "--set",
        "radar.frame.interval=70 us",
    ]

    document = json.loads(run_cli(*arguments, "--json")[1])

    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert strongest["velocity_m_per_s"] == pytest.approx(-4, abs=0.8)


@pytest.mark.parametrize("is_given", nightly_except(1, [True, False]))
def test_set_option_changes_settings_that_do_not_fit_capture(run_cli, folder, is_given):
    # A quarter of a frame: 8 chirps of 64 complex samples.
    samples = np.random.default_rng(2).integers(-99, 99, 8 * 64 * 2).astype(np.int16)
    (folder / "capture.bin").write_bytes(samples.tobytes())
    lines = [
        "channelCfg 1 1 0",
        "adcCfg 2 1",
        "adcbufCfg -1 0 0 1 1",
        "profileCfg 0 77 10 5 30 0 0 60 1 64 4000 0 0 30",
        "chirpCfg 0 0 0 0 0 0 0 1",
        "frameCfg 0 0 32 0 50 1 0",
    ]
    (folder / "radar.cfg").write_text("\n".join(["% xWR18xx", *lines]))
    arguments = ["run", "capture.bin", *(["--radar", "radar.cfg"] if is_given else []), "--quiet"]

    status, text, _ = run_cli(*arguments[:-1], "--json")
    assert status == 0
    (finding,) = (f for f in json.loads(text)["findings"] if "n_chirps" in f["setting"])
    assert "according to radar.cfg" in finding["expected"]
    assert "--set radar.frame.n_chirps=8" in finding["value"]

    change = ("--set", "radar.frame.n_chirps=8")
    assert run_cli(*arguments, *change) == (0, "", "")
    assert dc.load("dechirp-run/scenario.yaml").radar.frame.n_chirps == 8


@pytest.mark.parametrize(
    ("change", "fix"),
    [
        ("n_frames=2", "--frames 10"),
        ("impairments=[]", "remove it"),
        ("seed=3", "only the noise of a simulation has a seed"),
        ("engine.kernel=direct", "only a simulation has an engine"),
    ],
)
def test_settings_of_simulations_are_refused_for_recordings(
    collect_errors, recording_arguments, change, fix
):
    (error,) = collect_errors(*recording_arguments, "--set", change)

    assert error["setting"] == f"--set {change.partition('=')[0]}"
    assert fix in error["fix"]


def test_seed_is_refused_for_recordings(collect_errors, recording_arguments):
    (error,) = collect_errors(*recording_arguments, "--seed", "3")

    assert (error["setting"], error["value"]) == ("--seed", "given for a recording")


def test_options_in_findings_are_never_broken(capsys):
    option = "--set chain.detector.training='range: 8, velocity: 8'"
    finding = Finding(
        level="note",
        setting="chain",
        value="x" * 30,
        expected="another value",
        fix=f"{'word ' * 6}{option}",
    )

    for paragraph in finding_paragraphs([finding]):
        open_stdout_console().print(paragraph)

    assert option in capsys.readouterr().out


def test_findings_are_wrapped_at_words_on_a_terminal_only(monkeypatch):
    option = "--set 'chain.mitigation=[{kind: interference-autoregression, threshold: 8}]'"
    finding = Finding(
        level="note",
        setting="recording.interference",
        value="bursts in 1 of 128 chirps, kurtosis up to 5.98: chirp 0 of frame 0",
        expected="noise of constant power throughout a chirp, with kurtosis 3",
        fix=f"repair these chirps: {option}",
    )
    monkeypatch.setenv("COLUMNS", "60")
    (redirected,) = finding_paragraphs([finding])
    assert redirected.plain == f"note: {finding}"

    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    (wrapped,) = finding_paragraphs([finding])

    lines = wrapped.plain.split("\n")
    assert " ".join(" ".join(lines).split()) == redirected.plain
    assert all(len(line) <= 60 for line in lines if option not in line)
    assert lines[-1] == f"  {finding.fix}"


def test_warnings_and_chosen_options_come_first_and_are_short(monkeypatch):
    option = "--set chain.cfar.n_training.range=0 --set chain.cfar.n_training.velocity=8"
    note, choice, warning = (
        Finding(level=level, setting="chain", value=value, expected="another", fix="change it")
        for level, value in (
            ("note", "a value"),
            ("note", f"chosen {option} because static echoes hide another"),
            ("warning", "a value"),
        )
    )
    paragraphs = [text.plain for text in finding_paragraphs([note, choice, warning])]
    assert paragraphs == [
        f"warning: {warning}",
        f"note: chosen {option} because static echoes hide another",
        f"note: {note}",
    ]

    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    (wrapped,) = finding_paragraphs([choice])
    assert wrapped.plain.split("\n") == [
        f"note: chosen {option}",
        "  because static echoes hide another",
    ]


def test_notes_below_a_table_are_short_and_refer_to_the_report(monkeypatch):
    def make_finding(level, value="a value", fix="change it"):
        return Finding(level=level, setting="chain", value=value, expected="another", fix=fix)

    note, warning = make_finding("note", "a" + 9 * " value"), make_finding("warning")
    choice = make_finding("note", "chosen --set a=1 because static echoes hide another")
    option = make_finding("note", fix="add --vital-signs to measure them")
    report = Path("out/report.html")

    texts = [
        text.plain for text in short_finding_paragraphs([note, choice, warning], report=report)
    ]

    assert texts[:3] == [
        f"warning: {warning}",
        f"note: {choice.value}",
        f"note: chain: {note.value}",
    ]
    assert texts[3].endswith(f"Findings in {report}")
    (text, _) = short_finding_paragraphs([option], report=report)
    assert text.plain == "note: chain: a value; add --vital-signs to measure them"
    assert not list(short_finding_paragraphs([], report=report))
    assert len(list(short_finding_paragraphs([warning, choice], report=report))) == 2
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    (wrapped, _) = short_finding_paragraphs([note], report=report)
    assert all(len(line) <= 40 for line in wrapped.plain.split("\n"))


def test_scenario_of_recording_omits_unused_settings(run_cli, recording_arguments):
    run_cli(*recording_arguments, "--frames", "1:3")

    text = Path("dechirp-run/scenario.yaml").read_text()
    assert "frames: [1, 3]" in text
    assert "n_frames" not in text
    assert "impairments" not in text


def test_training_window_larger_than_map_of_recording_names_setting(
    collect_errors, recording_arguments
):
    [error] = collect_errors(*recording_arguments, "--set", "chain.cfar.n_training.velocity=80")

    assert error["setting"] == "chain.cfar.n_training"


def test_report_of_later_frames_shows_peak_over_threshold(run_cli, recording_arguments):
    run_cli(*recording_arguments, "--frames", "2:3")

    assert "over the threshold" in Path("dechirp-run/report.html").read_text()


def test_rejects_frames_beyond_end_of_recording(collect_errors, recording_arguments):
    [error] = collect_errors(*recording_arguments, "--frames", "2:4")

    assert error["value"].startswith("of 3 frames")


# Invalid calls


@pytest.mark.parametrize(
    ("arguments", "setting", "value", "fix"),
    nightly_except(
        12,
        [
            (["rn"], "command", "rn", "did you mean run?"),
            (
                ["run", "--sed", "1"],
                "--sed",
                "not an option of this command",
                "did you mean --seed?",
            ),
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
            (
                ["run", "--axes", "chirp,sample"],
                "--axes",
                "given for a simulated scene",
                "remove it",
            ),
            (["run", "--out", "small.yaml"], "--out", "small.yaml, a file", "name a folder"),
            (["run", "--out", "."], "--out", "., the working folder", "name a folder inside"),
            (["run", "--out", "small.yaml/x"], "--out", "small.yaml/x, not writable", "name a wri"),
            (["run", "--out", ".."], "--out", "..", "name a folder inside"),
            (
                ["design", *ALL_REQUIREMENTS, "--set", "limts.idle=1us"],
                "limts",
                "unknown setting",
                "did you mean lim",
            ),
            (
                ["design", *ALL_REQUIREMENTS, "--set", "limits.idle=1"],
                "limits.idle",
                "1",
                "units that fit",
            ),
            (
                ["design", *ALL_REQUIREMENTS, "--set", "limits.idle=1us"],
                "--set",
                "a limit, together",
                "add --rule",
            ),
            (["list", "cfra"], "FAMILY", "cfra", "did you mean cfar?"),
            (["list", "detectors"], "FAMILY", "detectors", "did you mean cfar?"),
            (
                ["design", *RANGE_REQUIREMENTS, "--max-velocity", "100"],
                "--max-velocity",
                "100",
                "units that fit",
            ),
            (
                ["design", *RANGE_REQUIREMENTS, "--max-velocity", "-9 m/s"],
                "--max-velocity",
                "-9 m/s",
                "give a",
            ),
            (["design", *RANGE_REQUIREMENTS], "--max-velocity", "missing", "add --max-velocity"),
            (["design", "--rule", "thumb"], "--rule", "thumb", "use one of these"),
        ],
    ),
    ids=lambda part: " ".join(part[:3]) if isinstance(part, list) else "",
)
def test_rejects_invalid_calls_with_setting_value_and_fix(
    collect_errors, arguments, setting, value, fix
):
    [error] = collect_errors(*arguments)

    assert error["setting"] == setting
    assert error["value"].startswith(value)
    assert error["fix"].startswith(fix)
    assert error["file"] in (None, "--set")
    assert error["file"] is None or "--set" in arguments


def test_command_without_options_suggests_none(run_cli):
    explanation = "not an option of this command; expected no options; see dechirp schema --help"
    assert run_cli("schema", "--pdf") == (2, "", f"--pdf: {explanation}\n")


@pytest.mark.parametrize("arguments", [["run", "--seed", "x"], ["run", "--sed", "1"]])
def test_json_option_with_value_gives_errors_as_json(run_cli, arguments):
    status, out, err = run_cli(*arguments, "--json=true")

    assert (status, err) == (2, "")
    assert [list(error) for error in json.loads(out)["errors"]] == [ERROR_KEYS]


def test_all_invalid_options_are_reported_at_once(collect_errors):
    errors = collect_errors(
        "design", "--max-range", "200", "--range-resolution", "1 s", "--band", "60"
    )

    assert {error["setting"]: error["value"] for error in errors} == {
        "--max-range": "200",
        "--range-resolution": "1 s",
        "--max-velocity": "missing",
        "--band": "60",
    }


# Invalid files


@pytest.mark.parametrize(
    ("old", "new", "line", "setting", "value", "fix"),
    [
        (
            "n_chirps",
            "n_chrips",
            7,
            "radar.frame.n_chrips",
            "unknown setting",
            "did you mean n_chirps",
        ),
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
def test_error_in_settings_file_has_line_and_column(
    collect_errors, folder, old, new, line, setting, value, fix
):
    assert old in SCENARIO
    (folder / "wrong.yaml").write_text(SCENARIO.replace(old, new))

    error = collect_errors("run", "wrong.yaml")[0]

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
def test_conflict_between_settings_has_line_and_column(
    collect_errors, folder, old, new, line, setting
):
    assert old in SCENARIO
    (folder / "wrong.yaml").write_text(SCENARIO.replace(old, new))

    [error] = collect_errors("run", "wrong.yaml")

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
def test_conflict_caused_by_set_option_is_attributed_to_it(collect_errors, change):
    [error] = collect_errors("run", "small.yaml", "--set", change)

    assert error["file"] == "--set"
    assert change.startswith(error["setting"])


def test_errors_of_file_and_set_option_are_reported_together(collect_errors, folder):
    (folder / "wrong.yaml").write_text(SCENARIO.replace("12 dBm", "12 dBi"))

    errors = collect_errors(
        "run", "wrong.yaml", "--set", "chain.n_rang_bins=512", "--set", "radar.frme=1"
    )

    locations = {(error["file"], error["setting"]) for error in errors}
    assert locations == {
        ("wrong.yaml", "radar.hardware.transmit_power"),
        ("--set", "chain.n_rang_bins"),
        ("--set", "radar.frme"),
    }


def test_rejects_scene_larger_than_memory_before_simulation(collect_errors, folder):
    [error] = collect_errors("run", "small.yaml", "--set", "radar.frame.n_chirps=1000000000")

    # 3 cubes of 1e9 chirps x 128 samples x 8 bytes.
    assert error["value"] == "2.86e+03 GiB of memory"
    assert "GiB, the free memory" in error["expected"]
    assert not (folder / "dechirp-run").exists()


def write_nan_recording(file):
    np.save(file, np.full((32, 128), np.nan, np.complex64))


@pytest.mark.parametrize(
    ("name", "write_recording", "value"),
    nightly_except(
        3,
        [
            ("none.npy", lambda file: None, "not readable (no such file or folder)"),
            ("empty.npy", lambda file: file.write_bytes(b""), "an empty file"),
            ("text.npy", lambda file: file.write_text("1 2 3"), "text"),
            ("cut.npy", lambda file: file.write_bytes(Path("car.npy").read_bytes()[:5000]), ""),
            ("size.npy", lambda file: np.save(file, np.zeros((32, 127), np.complex64)), ""),
            ("nan.npy", write_nan_recording, ""),
            ("cut.bin", lambda file: file.write_bytes(bytes(range(100))), "100 bytes"),
        ],
    ),
    ids=["absent", "empty", "text", "truncated", "other size", "nan", "short bin"],
)
def test_rejects_invalid_recording_files(
    collect_errors, recording_arguments, folder, name, write_recording, value
):
    write_recording(folder / name)
    axes = ["--axes", "chirp,sample"] if name.endswith(".npy") and name != "cut.npy" else []
    axes = recording_arguments[4:] if name == "cut.npy" else axes

    [error] = collect_errors("run", name, "--radar", "radar.yaml", *axes)

    assert error["value"].startswith(value)
    assert not (folder / "dechirp-run").exists()


def test_recording_without_radar_suggests_radar_option(collect_errors, recording_arguments, folder):
    (folder / "radar.yaml").unlink()

    [error] = collect_errors("run", "car.npy", *recording_arguments[4:])

    assert error["setting"] == "recording"
    assert "--radar FILE" in error["fix"]


def test_error_in_settings_of_recording_has_no_file_or_line(collect_errors, recording_arguments):
    [error] = collect_errors(*recording_arguments, "--set", "chain.cfar.offset=10 dB")

    assert error["file"] is error["line"] is None
    assert error["setting"] == "chain.cfar.false_alarm_probability"


# Design, list, doctor


def test_design_lists_every_number_with_formula(run_cli):
    status, out, err = run_cli("design", *RANGE_REQUIREMENTS, "--max-velocity", "100 m/s", "--json")

    document = json.loads(out, parse_constant=pytest.fail)
    assert (status, err) == (0, "")
    assert list(document) == ["chirp", "frame", "derived", "findings"]
    bandwidth = document["derived"]["bandwidth"]
    assert bandwidth == {"value": 149_896_229.0, "unit": "Hz", "formula": "c / 2 dR"}
    assert document["chirp"]["n_samples"] == 2200
    assert document["frame"]["n_chirps"] == 128
    _, table, _ = run_cli("design", *RANGE_REQUIREMENTS, "--max-velocity", "360 km/h")
    assert "149.896 MHz" in table
    assert "c / 2 dR" in table
    assert all(name.replace("_", " ") in table for name in document["derived"])


@pytest.mark.parametrize("rule", ["round-trips", "constraints"])
def test_infeasible_design_exits_with_1_and_names_requirement(run_cli, rule):
    arguments = ["design", *RANGE_REQUIREMENTS, "--max-velocity", "500 m/s", "--rule", rule]

    status, out, _ = run_cli(*arguments)

    assert status == 1
    assert "error: requirements." in out
    status, out, _ = run_cli(*arguments, "--json")
    assert status == 1
    assert json.loads(out)["findings"][0]["level"] == "error"


def test_design_options_override_requirements_file(run_cli, collect_errors, folder):
    (folder / "asked.yaml").write_text(
        "{max_range: 100 m, range_resolution: 1 m, max_velocity: 50 m/s, carier: 77 GHz}"
    )
    errors = collect_errors("design", "asked.yaml", "--max-range", "5")
    locations = [(error["file"], error["setting"], error["column"]) for error in errors]
    assert locations == [("asked.yaml", "carier", 65), (None, "--max-range", None)]

    text = (folder / "asked.yaml").read_text().replace("carier", "carrier")
    (folder / "asked.yaml").write_text(text)
    _, out, _ = run_cli("design", "asked.yaml", "--max-range", "200 m", "--json")
    assert json.loads(out)["chirp"]["n_samples"] == 2200


def test_design_accepts_limits_hardware_and_requirements_by_set(run_cli):
    arguments = ["design", *ALL_REQUIREMENTS, "--rule", "constraints", "--json"]

    def design_with(*changes):
        status, out, err = run_cli(*arguments, *(word for c in changes for word in ("--set", c)))
        assert (status, err) == (0, "")
        return json.loads(out)

    default_design, fast_design = design_with(), design_with("limits.idle=1us")
    # A shorter fly-back leaves more time for the ramp.
    assert fast_design["chirp"]["ramp_duration_s"] > default_design["chirp"]["ramp_duration_s"]
    assert design_with("requirements.max_range=100 m")["chirp"]["n_samples"] < 150
    # The EIRP is 60 dBm, above the default limits.
    high_power = "hardware.transmit_power=50dBm"
    status, out, _ = run_cli(*arguments, "--set", high_power)
    assert status == 1
    assert "hardware.transmit_power" in [
        finding["setting"] for finding in json.loads(out)["findings"]
    ]
    design_with(high_power, "limits.max_peak_eirp=70dBm", "limits.max_mean_eirp=70dBm")


def test_designed_radar_is_accepted_by_run(run_cli, folder):
    status, _, _ = run_cli(
        "design",
        *RANGE_REQUIREMENTS,
        "--max-velocity",
        "30 m/s",
        "--rule=constraints",
        "--out",
        "made.yaml",
    )
    assert status == 0

    status, out, _ = run_cli(*RUN_AS_JSON, "--radar", "made.yaml")

    radar = loading.read_settings(folder / "made.yaml", dc.Radar)
    assert status == 0
    assert json.loads(out)["radar"]["frame"]["interval_s"] == radar.frame.interval_s


def test_every_requirement_has_design_option(run_cli):
    _, out, _ = run_cli("design", "--help")

    assert all(f"--{name.replace('_', '-')}" in out for name in list_settings(dc.Requirements))


def test_list_shows_members_of_every_family_with_settings(run_cli):
    status, out, err = run_cli("list", "--json")

    families = json.loads(out)["families"]
    assert (status, err) == (0, "")
    assert " ".join(families) == (
        "angle body cfar device format generator impairment mitigation modulation multiplexing"
        " pattern score traffic witness writer"
    )
    assert (
        families["multiplexing"]["tdm"]["settings"]["order"]["expected"]
        == "a list, each a whole number"
    )
    assert {"dca1000", "infineon", "npy", "pcap", "ti-uart"} <= set(families["format"])
    snr = families["impairment"]["white-noise"]["settings"]["snr"]
    assert snr["required"]
    assert snr["default"] is None
    assert snr["expected"] == "a number or a ratio, such as 4 or 6 dB"
    assert "Echo power over noise power" in snr["help"]
    share = families["angle"]["capon"]["settings"]["smoothing.share"]
    assert share["expected"] == "a bare number"  # the default is the example
    gains = families["impairment"]["channel-mismatch"]["settings"]["gains"]
    assert gains["expected"] == "a list, each a number or a ratio, such as 4 or 6 dB, or null"
    assert all(member["help"] for members in families.values() for member in members.values())


def test_list_describes_every_setting(run_cli):
    families = json.loads(run_cli("list", "--json")[1])["families"]
    undescribed = [
        (family, kind, name)
        for family, base in family_base_classes().items()
        for kind, member in base.members().items()
        if member.__module__.startswith("dechirp.")  # other tests define members
        for name, setting in families[family][kind]["settings"].items()
        if not setting["help"]
    ]
    assert undescribed == []
    assert sum(len(members) for members in families.values()) > 100


def test_list_writes_defaults_for_readers(run_cli):
    _, out, _ = run_cli("list", "angle")

    assert re.search(
        r"smoothing\.share: .* \(default 0\.6667\)\. Share of each", " ".join(out.split())
    )
    assert not re.search(r"\{|\d\.\d{5}", out)


def test_list_of_one_family_omits_others(run_cli):
    status, out, _ = run_cli("list", "impairment")

    assert status == 0
    assert "white-noise" in out
    assert "cell-averaging" not in out


@pytest.fixture
def fake_installation(folder, monkeypatch):
    """Return a function that fakes package metadata with the given requirements."""

    def install(*lines: str) -> None:
        info_folder = folder / "dechirp-0.dist-info"
        info_folder.mkdir()
        requirement_lines = "".join(f"Requires-Dist: {line}\n" for line in lines)
        (info_folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: dechirp\nVersion: 0\n{requirement_lines}"
        )
        monkeypatch.syspath_prepend(folder)

    return install


def test_doctor_reports_dependencies_extras_and_kernels(run_cli, fake_installation):
    fake_installation("numpy>=2.0", 'pytest>=8; extra == "track"', "no-such-thing; extra == 'web'")

    status, out, _ = run_cli("doctor", "--json")

    document = json.loads(out)
    assert status == 0
    assert document["dependencies"] == {"numpy": np.__version__}
    assert document["extras"] == {
        "track": {"pytest": pytest.__version__},
        "web": {"no-such-thing": None},
    }
    assert "simd_range_doppler.transform_sample_blocks_over_chirps" in document["kernels"]
    assert document["problem"] is None
    assert document["cores"] >= document["threads"] >= 1
    assert document["free_memory_bytes"] > 0
    _, table, _ = run_cli("doctor")
    assert "without no-such-thing" in table
    assert "complete" in table


def test_doctor_exits_with_1_when_dependency_is_missing(run_cli, fake_installation):
    fake_installation("no-such-thing>=1")

    status, out, _ = run_cli("doctor")

    assert status == 1
    assert "missing" in out


CHEST = """\
n_frames: 120
radar:
  frame:
    chirp: {start_frequency: 60 GHz, slope: 100 MHz/us, ramp_duration: 18 us, sample_rate: 2 MHz,
            n_samples: 32, sampling: complex}
    n_chirps: 4
    interval: 1 ms
    period: 200 ms
  hardware: {transmit_power: 0 dBm, antenna_gain: 6 dBi, noise_factor: 12 dB}
scene:
  targets:
    - name: chest
      position: [0.9 m, 0, 0]
      body:
        kind: points
        scatterers:
          - position: [0, 0, 0]
            rcs: -20 dBsm
            oscillation: {amplitude: [1 mm, 0, 0], frequency: 0.3 Hz}
"""


@nightly
def test_run_measures_vital_signs_of_a_scene(run_cli, folder):
    (folder / "chest.yaml").write_text(CHEST)
    arguments = ("run", "chest.yaml", "--vital-signs")
    code, out, _ = run_cli(*arguments, "--json")
    (window,) = json.loads(out)["vital_signs"][:1]
    assert code == 0
    # 20 s resolve 0.05 Hz; the bound at 30 dB is below a hundredth of it.
    assert window["breathing_rate_hz"] == pytest.approx(0.3, abs=2e-3)
    assert window["breathing_amplitude_m"] == pytest.approx(1e-3, rel=0.05)
    assert window["heart_rate_hz"] is None
    _, out, _ = run_cli(*arguments)
    assert "18.0 (" in out and "not measurable" in out
    report = (folder / "dechirp-run" / "report.html").read_text()
    assert "Vital signs" in report and "18.0 (" in report
    assert "Displacement and its spectrum." in report


@nightly
def test_displacement_of_a_run_is_that_of_the_chest(folder):
    (folder / "chest.yaml").write_text(CHEST)
    result = add_vital_signs(dc.run(dc.load(folder / "chest.yaml")))

    displacement = result.displacement
    times_s = displacement.time.values
    # The amplitude is 1 mm; phases have 0.01 rad of noise at 40 dB, 4 um at 60 GHz. Trends take
    # a part of the first and the last period.
    wave = np.stack([np.sin(2 * np.pi * 0.3 * times_s), np.cos(2 * np.pi * 0.3 * times_s)], axis=1)
    weights, *_ = np.linalg.lstsq(wave, displacement.values, rcond=None)
    assert np.hypot(*weights) == pytest.approx(1e-3, rel=0.05)
    assert np.std(displacement.values - wave @ weights) < 1e-4
    axes = result.plot()
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 1e3 * displacement.values)


@nightly
def test_run_of_a_long_recording_of_a_person_names_vital_signs(run_cli, folder):
    (folder / "chest.yaml").write_text(CHEST)
    scenario = dc.load(folder / "chest.yaml", ["n_frames=60"])
    cube = dc.simulate(scenario.scene, scenario.radar, n_frames=60, seed=1)
    dc.write(dc.recording_from_cube(cube, scenario.radar), folder / "chest.npz")

    _, out, _ = run_cli("run", "chest.npz")
    assert "note: vital_signs: not measured: 11.8 s" in out
    assert "add --vital-signs" in out
    _, out, _ = run_cli("run", "chest.npz", "--vital-signs")
    assert "breathing (1/min)" in out
    assert "note: vital_signs" not in out
    _, out, _ = run_cli("run", "chest.npz", "--frames", "40")
    assert "vital_signs" not in out


def test_run_measures_vital_signs_of_a_slow_time_file(run_cli, folder):
    times = np.arange(0, 40, 0.05)
    # A chest that moves by 4 mm, 15 times a minute, at a wavelength of 5 mm; no noise but rounding.
    values = np.exp(4j * np.pi / 5 * 2 * np.sin(2 * np.pi * 0.25 * times))
    rows = [
        f"{94 + t:.3f},{value.real:.4f},{value.imag:.4f}"  # by the clock of a sensor
        for t, value in zip(times, values, strict=True)
    ]
    (folder / "chest.csv").write_text("\n".join(["time,I,Q", *rows]) + "\n")

    status, out, _ = run_cli("run", "chest.csv", "--vital-signs", "--json")

    (window, *_) = json.loads(out)["vital_signs"]
    assert status == 0
    assert 60 * window["breathing_rate_hz"] == pytest.approx(15, abs=0.1)
    assert window["time_s"] == pytest.approx(10, abs=0.05)  # the middle of the first 20 s
    status, out, _ = run_cli("run", "chest.csv", "--vital-signs")
    assert (status, "Vital signs" in out) == (0, True)
    (folder / "other.csv").write_text("a,b\n1,2\n")
    status, _, error = run_cli("run", "other.csv", "--vital-signs")
    assert (status, "columns for I" in error) == (2, True)


@nightly
def test_run_measures_vital_signs_unasked_where_there_are_no_chirps(run_cli, folder):
    times = np.arange(0, 40, 0.05)
    phase = 4 * np.pi / 5 * 2 * np.sin(2 * np.pi * 0.25 * times)
    rows = np.column_stack([times, np.cos(phase), np.sin(phase)])
    (folder / "rest").mkdir()
    for name in ("first", "second"):
        heading = {"header": "time,I,Q", "comments": "", "delimiter": ","}
        np.savetxt(folder / "rest" / f"{name}.csv", rows, "%.4f", **heading)

    for source in ("rest", "rest/first.csv"):
        status, out, _ = run_cli("run", source)
        assert (status, "Vital signs" in out) == (0, True)
        assert "note: --vital-signs: chosen because first.csv contains" in out
        assert ("give the path of another file to read that: second.csv" in out) == (
            source == "rest"
        )
        status, out, _ = run_cli("run", source, "--json")
        assert 60 * json.loads(out)["vital_signs"][0]["breathing_rate_hz"] == pytest.approx(
            15, abs=0.1
        )


@nightly
def test_traffic_file_of_a_folder_runs_into_the_same_results_twice(run_cli, folder):
    (folder / "crossing").mkdir()
    rows = [
        f"{t / 10},{number},car,{20 * number},0,0,4,2,1.5" for t in range(3) for number in (1, 2)
    ]
    text = "\n".join(["time,id,class,x,y,heading,length,width,height", *rows])
    (folder / "crossing" / "car.csv").write_text(text + "\n")

    for _ in range(2):
        assert run_cli("run", "crossing", "--frames", "3", "--ego", "1")[0] == 0
    assert (folder / "dechirp-run" / "traffic.csv").exists()

    (folder / "crossing" / "other.csv").write_text(text + "\n")
    status, _, error = run_cli("run", "crossing")
    assert (status, "a folder with 2 traffic files: car.csv, other.csv" in error) == (2, True)
    assert "dechirp run crossing/car.csv" in error


def test_vital_signs_need_time(run_cli, folder):
    code, _, err = run_cli("run", "small.yaml", "--vital-signs")
    assert code == 2 and "--vital-signs: 0 s long" in err and "10 s or more" in err
