"""Input folder for commands, and helpers to run commands in this process or in a shell."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from dechirp.cli.main import main
from nightly import nightly

# Unambiguous 75 m and 27 m/s, 1.2 m and 1.7 m/s per bin: a run takes 0.1 s.
SCENARIO = """\
name: small
seed: 5
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 2 us, ramp_duration: 30 us,
            sample_rate: 10 MHz, n_samples: 64, sampling: complex}
    n_chirps: 32
    interval: 35 us
  array:
    rx: [[0 mm, 0 mm, 0 mm], [0 mm, 1.944 mm, 0 mm]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: car, position: [30 m, 0 m, 0 m], velocity: [-8 m/s, 0 m/s, 0 m/s], rcs: 10.5 dBsm}
"""
STUDY = """\
scenario: small.yaml
seed: 7
vary: {scene.targets.car.rcs: [0 dBsm, 10 dBsm]}
trials: {at_most: 8, block: 4}
scores: [detection_probability]
keep: [cubes, detections]
"""

WRITE_COMMANDS = {
    "run": ("run", "small.yaml", "--out", "{out}"),
    "convert": ("convert", "in.npz", "{out}.npz", "--replace"),
    "inspect": ("inspect", "in.npz", "--out", "{out}"),
    "calibrate": (
        "calibrate",
        "still.npz",
        "--azimuth",
        "0 deg",
        "--range",
        "30 m",
        "--out",
        "{out}.json",
    ),
    "fixed-point": ("fixed-point", "small.yaml", "--out", "{out}"),
    "generate": ("generate", "c", "small.yaml", "--out", "{out}"),
    "twin": ("twin", "in.npz", "--out", "{out}"),
}
"""Commands that write results, with their arguments."""
each_write_command = pytest.mark.parametrize(
    "command",
    [
        "run",
        "convert",
        *(
            pytest.param(name, marks=nightly)
            for name in WRITE_COMMANDS
            if name not in ("run", "convert")
        ),
    ],
)
"""Parametrisation over these commands; five run nightly, since the first two cover the writer."""

CallResult = tuple[int, str, str]


def command_arguments(command: str, out: str | Path) -> list[str]:
    """Return the arguments of a command that writes to `out`."""
    return [word.format(out=out) for word in WRITE_COMMANDS[command]]


def read_folder(folder: Path) -> dict[str, bytes | None]:
    """Read every file under a folder, hidden files included."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture(scope="session")
def input_folder(tmp_path_factory) -> Path:
    """Make a scenario, a study and a recording of it, and a recording of a static target."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.yaml").write_text(SCENARIO)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "still.yaml").write_text(SCENARIO.replace("-8 m/s", "0 m/s"))
    for scene, recording in (("small", "in"), ("still", "still")):
        with pytest.raises(SystemExit) as exit_info:
            main(("convert", f"{folder}/{scene}.yaml", f"{folder}/{recording}.npz", "--quiet"))
        assert not exit_info.value.code
    return folder


@pytest.fixture
def folder(input_folder, tmp_path, monkeypatch, without_figures) -> Path:
    """Change to a folder with copies of the input files."""
    working_folder = tmp_path / "here"
    shutil.copytree(input_folder, working_folder)
    monkeypatch.chdir(working_folder)
    return working_folder


@pytest.fixture
def call(capsys) -> Callable[..., CallResult]:
    """Return a function that runs a command here and returns status, output and errors."""

    def run_main(*arguments: str) -> CallResult:
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_info:
            main(arguments)
        return int(exit_info.value.code or 0), *capsys.readouterr()

    return run_main


def run_shell(
    line: str, *arguments: str, **environment: str | None
) -> subprocess.CompletedProcess[str]:
    """Run a shell line; "$@" is dechirp with the given arguments. None unsets a variable."""
    paths = os.pathsep.join(path for path in sys.path if path)
    variables = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(
        ["/bin/bash", "-c", line, "bash", sys.executable, "-m", "dechirp", *arguments],
        env={name: text for name, text in variables.items() if text is not None},
        stdin=subprocess.DEVNULL,
        text=True,
        capture_output=True,
        check=False,
        timeout=300,
    )
