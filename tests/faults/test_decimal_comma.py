"""Locales: numbers have a point and words are English in all that is written."""

import json
import locale
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from dechirp.report.template import format_date
from faults.conftest import shell
from nightly import nightly

GERMAN = ("de_DE.UTF-8", "de_DE.utf8", "de_DE", "German_Germany.1252")


@pytest.fixture
def comma(tmp_path_factory, monkeypatch):
    """Have this process in a locale with decimal commas, as a program around it may set one."""
    before = locale.setlocale(locale.LC_ALL)

    def is_set() -> bool:
        for name in GERMAN:
            try:
                locale.setlocale(locale.LC_ALL, name)
            except locale.Error:
                continue
            return True
        return False

    if not is_set():
        place = tmp_path_factory.getbasetemp() / "locales"
        place.mkdir(exist_ok=True)
        made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(place / "de_DE.UTF-8")]
        if shutil.which(made[0]):
            subprocess.run(made, check=False, capture_output=True)
        monkeypatch.setenv("LOCPATH", str(place))
        if not is_set():
            pytest.skip("no locale with a decimal comma can be had here")
    assert locale.localeconv()["decimal_point"] == ","
    yield
    locale.setlocale(locale.LC_ALL, before)


def results(out: Path) -> dict[str, bytes]:
    """All that is written of a run, without how long it took."""
    texts = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    document = json.loads(texts.pop("run.json"))
    texts["run.json"] = json.dumps({**document, "timing_s": None, "files": None}).encode()
    page = texts["report.html"].splitlines()
    texts["report.html"] = b"\n".join(
        line for line in page if b'class="time"' not in line and b"Total: " not in line
    )
    return texts


def test_what_is_read_and_written_is_the_same_to_the_byte(folder, call, comma):
    assert call("run", "small.yaml", "--out", "comma", "--quiet")[0] == 0
    assert call("convert", "in.npz", "comma.csv", "--quiet")[0] == 0
    locale.setlocale(locale.LC_ALL, "C")
    assert call("run", "small.yaml", "--out", "point", "--quiet")[0] == 0
    assert call("convert", "in.npz", "point.csv", "--quiet")[0] == 0

    assert results(folder / "comma") == results(folder / "point")
    assert (folder / "comma.csv").read_bytes() == (folder / "point.csv").read_bytes()


def test_a_month_is_in_english(comma):
    assert format_date("2026-05-03T09:05:00+00:00") == "3 May 2026, 09:05 UTC"


@nightly
def test_names_that_are_not_ascii_go_through_a_terminal_that_is(folder):
    text = (folder / "small.yaml").read_text().replace("name: car", "name: Löwe")
    (folder / "Straße.yaml").write_text(text, encoding="utf-8")
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LOCPATH": None}
    ended = shell('"$@"', "run", "Straße.yaml", "--json", **plain)

    assert (ended.returncode, ended.stderr) == (0, "")
    document = json.loads(ended.stdout)
    assert document["truth"][0]["target"] == "Löwe"
    assert os.fsencode(document["source"]) == "Straße.yaml".encode()
