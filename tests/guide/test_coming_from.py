"""Rows of the page on other tools: each expression runs; OpenRadar gives the same numbers."""

import inspect
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc

PAGE = (Path(__file__).parents[2] / "docs/guide/coming-from.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## Functions on arrays")[2].partition("\n## ")[0]
ROWS = [
    line.split("|")[1:4]
    for line in SECTION.splitlines()
    if "| dechirp |" not in line and line.startswith("| `")
]
RADARSIMPY = """range_fft doppler_fft range_doppler_fft cfar_ca_1d cfar_ca_2d os_cfar_threshold
    cfar_os_1d cfar_os_2d doa_music doa_root_music doa_esprit doa_iaa doa_bartlett doa_capon
    marcumq log_factorial threshold pd_swerling0 pd_swerling4 roc_pd roc_snr"""


@cache
def page_names():
    """Run the cells up to the tables, as a reader does."""
    cells = re.findall(
        r"```\{code-cell\} python\n(.*?)```", PAGE.partition("### RadarSimPy")[0], re.S
    )
    names = {}
    for cell in cells:
        exec(cell, names)
    return names


@pytest.mark.parametrize("expressions", [row[1] for row in ROWS], ids=[row[0] for row in ROWS])
def test_expressions_of_row_run(expressions):
    code = re.findall(r"`([^`]+)`", expressions)
    assert code
    for expression in code:
        result = eval(expression, page_names())
        if isinstance(result, np.ndarray | float):
            assert np.isfinite(result).all()


def test_tables_contain_every_function_of_radarsimpy_and_openradar():
    documented = set(re.findall(r"\w+", " ".join(row[0] for row in ROWS)))
    assert set(RADARSIMPY.split()) <= documented
    dsp = pytest.importorskip("mmwave.dsp")
    for module in (vars(dsp)[name] for name in dir(dsp) if inspect.ismodule(vars(dsp)[name])):
        if module.__name__.startswith("mmwave.dsp."):
            functions = inspect.getmembers(module, inspect.isfunction)
            defined = {name for name, f in functions if f.__module__ == module.__name__}
            private = {name for name in defined if name.startswith("_")}
            assert defined - private <= documented, module.__name__


def test_spectrum_equals_that_of_openradar():
    dsp = pytest.importorskip("mmwave.dsp")
    rng = np.random.default_rng(2)
    samples = rng.standard_normal((6, 3, 32)) + 1j * rng.standard_normal((6, 3, 32))
    foreign = np.fft.fftshift(np.fft.fft(dsp.range_processing(samples), axis=0), axes=0) / (6 * 32)
    spectrum = dc.maps.range_doppler_spectrum(samples, "rectangular", axes=(0, 2))
    np.testing.assert_allclose(spectrum, np.moveaxis(foreign, 1, 0), atol=1e-6)


def test_threshold_has_the_mean_of_openradar():
    dsp = pytest.importorskip("mmwave.dsp")
    power = np.random.default_rng(3).exponential(size=100)
    _, mean = dsp.ca_(power, guard_len=2, noise_len=5, mode="constant", l_bound=0)
    threshold = dc.cfar.cfar_threshold(power, 5, 2, 1e-3)
    # Away from the ends, where dechirp takes the nearest cells that exist.
    ratio = (threshold / mean)[7:-7]
    np.testing.assert_allclose(ratio, dc.theory.cfar_factor(1e-3, 10), rtol=1e-5)


def test_beams_equal_those_of_openradar():
    dsp = pytest.importorskip("mmwave.dsp")
    rng = np.random.default_rng(4)
    snapshot = rng.standard_normal(8) + 1j * rng.standard_normal(8)
    azimuth = np.radians(np.arange(-60, 61))
    # Their own function for these vectors requires NumPy before 1.24.
    steering = np.exp(1j * np.pi * np.outer(np.sin(azimuth), np.arange(8)))
    foreign = dsp.aoa_bartlett(steering, snapshot[:, None], axis=0)
    power = dc.angle.direction_spectrum(snapshot.conj(), 0.5 * np.arange(8), azimuth)
    ratio = np.ravel(foreign) / power
    np.testing.assert_allclose(ratio, 64, rtol=1e-4)
