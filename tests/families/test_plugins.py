"""Plug-ins from `examples/guests` and broken plug-ins, each run in a separate process."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.config.yaml_tree import parse_yaml
from nightly import nightly

SRC = Path(dc.__file__).parent.parent
PLUGINS = SRC.parent / "examples" / "guests"


def run_python(*arguments, path, cwd):
    """Run Python with the packages of a folder in addition to the installed ones."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(path), str(SRC)])},
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


def run_dechirp(*arguments, path, cwd):
    return run_python("-m", "dechirp", *arguments, path=path, cwd=cwd)


@pytest.fixture(scope="module")
def plugin_folder(tmp_path_factory):
    """Install the example package with pip into a temporary folder."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("guests")
    options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    pip = run_python(
        "-m", "pip", "install", *options, "--target", folder, PLUGINS, path=folder, cwd=folder
    )
    assert pip.returncode == 0, pip.stderr
    return folder


@nightly
def test_example_plugins_pass_their_own_tests(plugin_folder, tmp_path):
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--basetemp", tmp_path / "made"]
    process = run_python(
        "-m", "pytest", *options, PLUGINS / "tests", path=plugin_folder, cwd=PLUGINS
    )
    assert process.returncode == 0, process.stdout


@nightly
def test_plugins_are_listed_with_their_settings(plugin_folder, tmp_path):
    process = run_dechirp("list", "--json", path=plugin_folder, cwd=tmp_path)
    families = json.loads(process.stdout)["families"]
    assert process.stderr == ""
    assert families["cfar"]["log-mean"] == {
        "help": "Geometric mean of the training cells.",
        "experimental": False,
        "settings": {},
    }
    spur = families["impairment"]["spur"]["settings"]
    assert spur["frequency"]["required"] and "GHz" in spur["frequency"]["expected"]
    assert spur["power"]["help"].startswith("Referred to the antenna")
    assert "json-header" in families["format"]


@nightly
def test_plugins_are_in_schema_for_editors(plugin_folder, tmp_path):
    from jsonschema import Draft202012Validator

    process = run_dechirp("schema", path=plugin_folder, cwd=tmp_path)
    assert process.stderr == ""
    schema = json.loads(process.stdout)
    checker = Draft202012Validator(schema)
    spur = parse_yaml((PLUGINS / "spur.yaml").read_text(encoding="utf-8"), "").plain_data
    assert list(checker.iter_errors(spur)) == []
    spur["impairments"][1]["frequency"] = "4 m"
    assert [error.message for error in checker.iter_errors(spur)] != []


@pytest.fixture
def broken_plugin_folder(tmp_path):
    """Create packages that cannot be loaded, or are not members."""
    (tmp_path / "needs_more.py").write_text("import a_package_that_is_not_there\n")
    (tmp_path / "half_done.py").write_text(
        "from dechirp.processing.cfar.base import NoiseEstimator\n\n\n"
        "class HalfDone(NoiseEstimator):\n"
        "    pass\n"
    )
    folder = tmp_path / "broken-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[dechirp.cfar]\n"
        "needs-more = needs_more:NeedsMore\n"
        "half-done = half_done:HalfDone\n"
        "a-decoder = json:JSONDecoder\n"
        "[dechirp.format]\n"
        "needs-more = needs_more:NeedsMore\n"
    )
    return tmp_path


@nightly
def test_broken_plugins_are_named_and_other_members_remain(broken_plugin_folder):
    listing = run_dechirp("list", "cfar", path=broken_plugin_folder, cwd=broken_plugin_folder)
    assert listing.returncode == 0 and "ordered-statistic" in listing.stdout
    assert "needs-more" not in listing.stdout and "half-done" not in listing.stdout
    reasons = {
        "needs-more": "raises ModuleNotFoundError: No module named 'a_package_that_is_not_there'",
        "half-done": "half_done:HalfDone does not define statistic",
        "a-decoder": "json:JSONDecoder is not a NoiseEstimator",
    }
    for kind, reason in reasons.items():
        assert any(kind in line and reason in line for line in listing.stderr.splitlines())

    code = (
        "import dechirp as dc\n"
        "dc.reference(['chain.cfar.estimator={kind: ordered-statistic}'])\n"
        "for kind in ('needs-more', 'half-done', 'a-decoder'):\n"
        "    try:\n"
        "        dc.reference(['chain.cfar.estimator={kind: %s}' % kind])\n"
        "    except dc.DechirpError as error:\n"
        "        print(error)\n"
        "try:\n"
        "    dc.open(__import__('sys').argv[1], format='needs-more')\n"
        "except dc.RecordingError as error:\n"
        "    print(error)\n"
    )
    process = run_python(
        "-c",
        code,
        broken_plugin_folder / "half_done.py",
        path=broken_plugin_folder,
        cwd=broken_plugin_folder,
    )
    assert process.returncode == 0, process.stderr
    *errors, format_error = process.stdout.splitlines()
    for (kind, reason), error in zip(reasons.items(), errors, strict=True):
        assert f"kind: {kind}, which cannot be loaded" in error and reason in error
    assert "format 'needs-more', which cannot be loaded" in format_error
