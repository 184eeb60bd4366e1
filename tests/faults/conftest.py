"""A folder with all that commands need, and two ways to call them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from dechirp.cli.main import main
from nightly import nightly

# 75 m and 27 m/s unambiguous, 1.2 m and 1.7 m/s a bin: a run of it takes 0.1 s.
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

WRITES = {
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
    "twin": ("twin", "in.npz", "--out", "{out}"),
}
"""Commands that write results, the words of a call of each."""
writing = pytest.mark.parametrize(
    "command",
    [
        "run",
        "convert",
        *(pytest.param(name, marks=nightly) for name in WRITES if name not in ("run", "convert")),
    ],
)
"""For each of them, four by night: what writes is shared, and it is by the first two."""

Called = tuple[int, str, str]


def words(command: str, out: str | Path) -> list[str]:
    """Words of a call of a command that writes there."""
    return [word.format(out=out) for word in WRITES[command]]


def there(folder: Path) -> dict[str, bytes | None]:
    """Every file under a folder with its content, hidden ones too."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Path:
    """Make a scenario, a study of it, a recording of it, and one of a target that stands still."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.yaml").write_text(SCENARIO)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "still.yaml").write_text(SCENARIO.replace("-8 m/s", "0 m/s"))
    for scene, recording in (("small", "in"), ("still", "still")):
        with pytest.raises(SystemExit) as ended:
            main(("convert", f"{folder}/{scene}.yaml", f"{folder}/{recording}.npz", "--quiet"))
        assert not ended.value.code
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch) -> Path:
    """Give a folder to be in, with copies of those."""
    here = tmp_path / "here"
    shutil.copytree(made, here)
    monkeypatch.chdir(here)
    return here


@pytest.fixture
def call(capsys) -> Callable[..., Called]:
    """Call the command line in this process: its status, standard output and standard error."""

    def called(*given: str) -> Called:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(given)
        return int(ended.value.code or 0), *capsys.readouterr()

    return called


def shell(line: str, *given: str, **environment: str | None) -> subprocess.CompletedProcess[str]:
    """Run a line of a shell; in it "$@" is dechirp with the given words. None unsets a variable."""
    paths = os.pathsep.join(path for path in sys.path if path)
    asked = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(
        ["/bin/bash", "-c", line, "bash", sys.executable, "-m", "dechirp", *given],
        env={name: text for name, text in asked.items() if text is not None},
        stdin=subprocess.DEVNULL,
        text=True,
        capture_output=True,
        check=False,
        timeout=300,
    )
