"""Locales: written files have decimal points and English words in every locale."""

import json
import locale
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from dechirp.report.template import format_date_and_time
from faults.conftest import run_shell
from nightly import nightly

GERMAN = ("de_DE.UTF-8", "de_DE.utf8", "de_DE", "German_Germany.1252")


@pytest.fixture
def comma_locale(tmp_path_factory, monkeypatch):
    """Set a locale with decimal commas for this process, as an embedding program may do."""
    original_locale = locale.setlocale(locale.LC_ALL)

    def set_german_locale() -> bool:
        for name in GERMAN:
            try:
                locale.setlocale(locale.LC_ALL, name)
            except locale.Error:
                continue
            return True
        return False

    if not set_german_locale():
        locale_folder = tmp_path_factory.getbasetemp() / "locales"
        locale_folder.mkdir(exist_ok=True)
        command = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(locale_folder / "de_DE.UTF-8")]
        if shutil.which(command[0]):
            subprocess.run(command, check=False, capture_output=True)
        monkeypatch.setenv("LOCPATH", str(locale_folder))
        if not set_german_locale():
            pytest.skip("no locale with a decimal comma: install de_DE.UTF-8")
    assert locale.localeconv()["decimal_point"] == ","
    yield
    locale.setlocale(locale.LC_ALL, original_locale)


def read_results(out: Path) -> dict[str, bytes]:
    """Read all files of a run, without durations."""
    texts = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    document = json.loads(texts.pop("run.json"))
    texts["run.json"] = json.dumps({**document, "timing_s": None, "files": None}).encode()
    page = texts["report.html"].splitlines()
    texts["report.html"] = b"\n".join(
        line for line in page if b'class="time"' not in line and b"Total: " not in line
    )
    return texts


@nightly
def test_files_do_not_depend_on_locale(folder, call, comma_locale):
    assert call("run", "small.yaml", "--out", "comma", "--quiet")[0] == 0
    assert call("convert", "in.npz", "comma.csv", "--quiet")[0] == 0
    locale.setlocale(locale.LC_ALL, "C")
    assert call("run", "small.yaml", "--out", "point", "--quiet")[0] == 0
    assert call("convert", "in.npz", "point.csv", "--quiet")[0] == 0

    assert read_results(folder / "comma") == read_results(folder / "point")
    assert (folder / "comma.csv").read_bytes() == (folder / "point.csv").read_bytes()


@nightly
def test_month_names_are_english(comma_locale):
    assert format_date_and_time("2026-05-03T09:05:00+00:00") == "3 May 2026, 09:05 UTC"


@nightly
def test_names_beyond_ascii_survive_c_locale(folder):
    text = (folder / "small.yaml").read_text().replace("name: car", "name: Löwe")
    (folder / "Straße.yaml").write_text(text, encoding="utf-8")
    c_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LOCPATH": None}
    process = run_shell('"$@"', "run", "Straße.yaml", "--json", **c_locale)

    assert (process.returncode, process.stderr) == (0, "")
    document = json.loads(process.stdout)
    assert document["truth"][0]["target"] == "Löwe"
    assert os.fsencode(document["source"]) == "Straße.yaml".encode()
