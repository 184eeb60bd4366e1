"""With what `pip install dechirp` brings alone, commands work, or name the extra that they need."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
# What the extras bring; whatever imports one of them finds nothing.
BLOCKED = (
    *("bokeh", "tornado", "stonesoup", "cantools", "can", "osi3", "mcap", "rosbags", "dask"),
    *("distributed", "dask_jobqueue", "optuna", "sklearn", "typst", "trimesh", "embreex"),
)
CALL = f"""
import sys
from importlib.machinery import PathFinder

class Without(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        blocked = name.partition(".")[0] in {BLOCKED}
        return None if blocked else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Without
from dechirp.cli.main import main
main()
"""


def call(folder, *words):
    return subprocess.run(
        [sys.executable, "-c", CALL, *map(str, words)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("words", ["list --json", "schema scenario", "doctor --json"])
def test_what_needs_no_extra_works(tmp_path, words):
    ended = call(tmp_path, *words.split())
    assert (ended.returncode, ended.stderr) == (0, "")
    assert json.loads(ended.stdout)


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (["studio", "--port", "0"], "web"),
        (["tune", EXAMPLES / "tune.yaml"], "tune"),
        (["run", "--pdf"], "pdf"),
        (["run", EXAMPLES / "crossing.yaml"], "track"),
        (["convert", EXAMPLES / "mimo.yaml", "out.mcap"], "io"),
    ],
)
def test_what_needs_one_says_which_and_writes_nothing(tmp_path, words, extra):
    ended = call(tmp_path, *words)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert f"pip install 'dechirp[{extra}]'" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not list(tmp_path.iterdir())
