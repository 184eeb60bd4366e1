"""Members from another package, `examples/guests`, each run in a process of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import dechirp as dc
from dechirp.config.yaml_tree import parse_yaml

SRC = Path(dc.__file__).parent.parent
GUESTS = SRC.parent / "examples" / "guests"


def python(*arguments, path, cwd):
    """Run with packages of a folder beside those that are installed."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(path), str(SRC)])},
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


def dechirp(*arguments, path, cwd):
    return python("-m", "dechirp", *arguments, path=path, cwd=cwd)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The package as pip installs it, in a folder of its own."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("guests")
    options = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    pip = python(
        "-m", "pip", "install", *options, "--target", folder, GUESTS, path=folder, cwd=folder
    )
    assert pip.returncode == 0, pip.stderr
    return folder


def test_the_guests_pass_the_tests_of_their_package(installed, tmp_path):
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--basetemp", tmp_path / "made"]
    done = python("-m", "pytest", *options, GUESTS / "tests", path=installed, cwd=GUESTS)
    assert done.returncode == 0, done.stdout


def test_guests_are_listed_with_their_settings(installed, tmp_path):
    done = dechirp("list", "--json", path=installed, cwd=tmp_path)
    families = json.loads(done.stdout)["families"]
    assert done.stderr == ""
    assert families["cfar"]["log-mean"] == {
        "help": "Geometric mean of the training cells.",
        "experimental": False,
        "settings": {},
    }
    spur = families["impairment"]["spur"]["settings"]
    assert spur["frequency"]["required"] and "GHz" in spur["frequency"]["expected"]
    assert spur["power"]["help"].startswith("Referred to the antenna")
    assert "json-header" in families["format"]


def test_guests_are_in_the_schema_for_editors(installed, tmp_path):
    done = dechirp("schema", path=installed, cwd=tmp_path)
    assert done.stderr == ""
    schema = json.loads(done.stdout)
    checker = Draft202012Validator(schema)
    spur = parse_yaml((GUESTS / "spur.yaml").read_text(encoding="utf-8"), "").plain_data
    assert list(checker.iter_errors(spur)) == []
    spur["impairments"][1]["frequency"] = "4 m"
    assert [error.message for error in checker.iter_errors(spur)] != []


@pytest.fixture
def broken(tmp_path):
    """Packages that cannot be loaded, or are no members."""
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


def test_a_guest_that_is_broken_is_told_by_name_and_takes_nothing_from_the_others(broken):
    listed = dechirp("list", "cfar", path=broken, cwd=broken)
    assert listed.returncode == 0 and "ordered-statistic" in listed.stdout
    assert "needs-more" not in listed.stdout and "half-done" not in listed.stdout
    said = {
        "needs-more": "raises ModuleNotFoundError: No module named 'a_package_that_is_not_there'",
        "half-done": "half_done:HalfDone does not define statistic",
        "a-decoder": "json:JSONDecoder is not a NoiseEstimator",
    }
    for kind, why in said.items():
        assert any(kind in line and why in line for line in listed.stderr.splitlines())

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
    tried = python("-c", code, broken / "half_done.py", path=broken, cwd=broken)
    assert tried.returncode == 0, tried.stderr
    *errors, of_format = tried.stdout.splitlines()
    for (kind, why), error in zip(said.items(), errors, strict=True):
        assert f"kind: {kind}, which cannot be loaded" in error and why in error
    assert "format 'needs-more', which cannot be loaded" in of_format
