"""Commands without optional extras: results, or the name of the missing extra."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.optional_imports import import_from_extra
from nightly import nightly, nightly_except

EXAMPLES = Path(__file__).parents[2] / "examples"
CORPUS = Path(__file__).parents[1] / "bad_input" / "corpus" / "recording"
# Modules of the extras; the script below hides them from imports.
BLOCKED_MODULES = (
    *("bokeh", "tornado", "stonesoup", "cantools", "can", "osi3", "mcap", "rosbags", "dask"),
    *("distributed", "dask_jobqueue", "optuna", "sklearn", "weasyprint", "trimesh", "embreex"),
    *("duckdb", "soundfile", "sigmf"),
)
SCRIPT = f"""
import sys
from importlib.machinery import PathFinder

class PartialFinder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        blocked = name.partition(".")[0] in {BLOCKED_MODULES}
        return None if blocked else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = PartialFinder
from dechirp.cli.main import main
main()
"""


def run_without_extras(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-c", SCRIPT, *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@nightly  # tests/test_package.py runs without extras too
@pytest.mark.parametrize("arguments", ["list --json", "schema scenario", "doctor --json"])
def test_commands_without_extras_work(tmp_path, arguments):
    process = run_without_extras(tmp_path, *arguments.split())
    assert (process.returncode, process.stderr) == (0, "")
    assert json.loads(process.stdout)


@pytest.mark.parametrize(
    ("arguments", "extra"),
    nightly_except(
        1,
        [
            (["studio", "--port", "0"], "web"),
            (["tune", EXAMPLES / "tune.yaml"], "tune"),
            (["run", "--pdf"], "pdf"),
            (["run", EXAMPLES / "crossing.yaml"], "track"),
            (["convert", EXAMPLES / "mimo.yaml", "out.mcap"], "io"),
            (["run", "--objects", "objects.parquet"], "parquet"),
        ],
    ),
)
def test_missing_extra_is_named_and_nothing_is_written(tmp_path, arguments, extra):
    process = run_without_extras(tmp_path, *arguments)
    assert (process.returncode, process.stdout) == (2, "")
    assert f"pip install 'dechirp[{extra}]'" in process.stderr
    assert "Traceback" not in process.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("source", "value"),
    [
        (
            "raise OSError('sndfile library not found')",
            "soundfile, which cannot be loaded: sndfile library not found",
        ),
        (
            "from json import no_such_name",
            "soundfile, which cannot be loaded: cannot import name 'no_such_name'",
        ),
        ("import no_such_module", "no_such_module, which is not installed"),
    ],
)
def test_extra_that_cannot_be_loaded_gives_the_reason(tmp_path, monkeypatch, source, value):
    (tmp_path / "soundfile.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "soundfile", raising=False)
    with pytest.raises(InvalidSetting) as caught:
        import_from_extra("io", "soundfile", setting="recording")
    message = str(caught.value)
    assert message.startswith(f"recording: a format that needs {value}")
    assert "pip install" in message
    assert "dechirp[io]" in message


@pytest.mark.parametrize(
    ("name", "content", "library"),
    [
        ("x.wav", (CORPUS / "sync-wav.wav").read_bytes(), "soundfile"),
        ("x.mcap", (CORPUS / "mcap.mcap").read_bytes(), "mcap"),
        ("x.sigmf-meta", b"{}", "sigmf"),
    ],
)
def test_recording_that_needs_an_extra_is_named(tmp_path, monkeypatch, name, content, library):
    monkeypatch.setitem(sys.modules, library, None)
    file = tmp_path / name
    file.write_bytes(content)
    for path in (file, tmp_path):  # as a file, and in a folder
        with pytest.raises(InvalidSetting) as caught:
            dc.open(path)
        assert str(caught.value) == (
            f"{file}: recording: a format that needs {library}, which is not installed; expected a"
            " format without optional dependencies, or the extra io installed;"
            " run pip install 'dechirp[io]'"
        )
