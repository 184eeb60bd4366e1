"""Lessons that run in a browser: drawn as Pyodide would draw them, and the page around them."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import dechirp
from nightly import nightly

FOLDER = Path(__file__).parents[2] / "examples" / "browser"
PAGE = (FOLDER / "lessons.html").read_text(encoding="utf-8")
PACKAGES = re.findall(r'"(\w+)"', PAGE.partition("PACKAGES = [")[2].partition("]")[0])

# Python as in a browser: the packages of the page and what they need, one thread, no psutil.
SCRIPT = """
import importlib.metadata, json, re, sys, threading

def required(name):
    lines = importlib.metadata.requires(name) or []
    names = {re.match(r"[\\w.-]+", line)[0].lower() for line in lines if "extra ==" not in line}
    return {name} | set().union(*map(required, names)) if names else {name}

available = set().union(*map(required, sys.argv[1].split()))
others = "numba llvmlite zarr numcodecs h5py pydantic ruamel pint cyclopts rich jinja2 markupsafe"
others += " psutil platformdirs loky cloudpickle bokeh tornado duckdb"
sys.modules |= dict.fromkeys(set(others.split()) - available)

def refuse(thread):
    raise RuntimeError("can't start new thread")

threading.Thread.start = refuse
import lessons

drawn = []
for number, lesson in enumerate(json.loads(lessons.describe_lessons())):
    ends = [
        control.get("options") or [control["value"], control["min"], control["max"]]
        for control in lesson["controls"]
    ]
    for positions in zip(*ends):
        svg = lessons.draw_lesson(number, json.dumps(positions))
        drawn.append(svg.startswith("<?xml") and "</svg>" in svg)
print(drawn)
"""


@nightly
def test_lessons_draw_with_packages_and_threads_of_browser():
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, " ".join(PACKAGES)],
        cwd=FOLDER,
        env={"PYTHONPATH": str(Path(dechirp.__file__).parents[1]), "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )

    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout.lower()) == 12 * [True]


@pytest.fixture
def lessons(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return pytest.importorskip("lessons")


def test_lesson_of_range_resolves_and_hides_weak_echo(lessons):
    """A Hann window reveals the echo 12 m behind one that is 40 dB stronger."""
    figure = lessons.Figure()
    lessons.draw_range_transform(figure, 2200, -40, "hann")
    range_m, power_db = figure.axes[0].lines[0].get_data()
    near = abs(range_m - 62) < 2
    assert abs(range_m[near][power_db[near].argmax()] - 62) < 0.1
    assert abs(power_db[near].max() + 40) < 1


@pytest.mark.parametrize(
    ("n_guard", "title"), [(0, "masked"), (4, "detected")], ids=["no guard", "guard"]
)
def test_lesson_of_velocity_shows_self_masking(lessons, n_guard, title):
    figure = lessons.Figure()
    lessons.draw_velocity(figure, -60, n_guard)
    assert figure.axes[0].get_title().startswith("Peak at -60")
    assert figure.axes[1].get_title() == title


@pytest.mark.parametrize(("snr_db", "title"), [(-36, "detected"), (-48, "not detected")])
def test_lesson_of_noise_detects_at_theoretical_limit(lessons, snr_db, title):
    figure = lessons.Figure()
    lessons.draw_noise(figure, snr_db, 1)
    assert figure.axes[0].get_title() == title
    snr_grid_db, probability = figure.axes[1].lines[0].get_data()
    # The limit of the certificate, with scalloping at 50 m and 10 m/s: see phase 4.
    assert abs(snr_grid_db[(probability > 0.9).argmax()] + 40.7) < 0.4


def test_page_names_wheel_of_this_version():
    assert f'"dechirp-{dechirp.__version__}-py3-none-any.whl"' in PAGE
