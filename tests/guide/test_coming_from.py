"""Rows of the page on other tools: each expression runs; OpenRadar gives the same numbers."""

import inspect
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy

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
    assert code or expressions.strip() == "-"
    for expression in code:
        result = eval(expression, page_names())
        if isinstance(result, np.ndarray | float):
            assert np.isfinite(result).all()


def test_near_field_correction_focuses_a_near_target():
    (expression,) = (row[1].strip(" `") for row in ROWS if "near_field_correction" in row[0])
    positions, range_wavelengths, angle_rad = 0.5 * np.arange(8) - 1.75, 20.0, 0.05
    path = np.sqrt(
        range_wavelengths**2 + positions**2 - 2 * range_wavelengths * positions * np.sin(angle_rad)
    )
    near = np.exp(2j * np.pi * (path - range_wavelengths))
    focused = eval(expression, {"np": np, "snapshots": near, "positions": positions})

    (azimuth,) = dc.angle.bartlett(focused, positions).azimuth_rad
    (power,) = dc.angle.bartlett(focused, positions).power
    # The correction leaves pi p^2 / R sin^2 of the angle: 1.2 mrad at the ends.
    assert power > 1 - 0.0012**2 and power > dc.angle.bartlett(near, positions).power + 0.02
    assert azimuth == pytest.approx(angle_rad, abs=1e-3)


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


DIRECTIONS_RAD = np.array([-0.3, 0.4])


def names_with(**values):
    return page_names() | values


@cache
def names_of_two_sources():
    """Return the names of the page with snapshots of two independent sources, 50 dB above noise."""
    rng, names = np.random.default_rng(5), page_names()
    noise = np.sqrt(0.05) * rng.standard_normal((64, 8, 2)) @ [1, 1j]  # of the power 0.1
    amplitudes = 100 * rng.standard_normal((64, 2))
    phases = np.outer(np.sin(DIRECTIONS_RAD), names["positions"])
    snapshots = amplitudes @ np.exp(-2j * np.pi * phases) + noise
    covariance = snapshots.T @ snapshots.conj() / 64
    from_covariance = dc.angle.snapshots_from_covariance(covariance, n_snapshots=64)
    return names_with(snapshots=snapshots, from_covariance=from_covariance)


def expressions_of(*words):
    """Return the code of the rows that contains one of the words, with the name of its row."""
    return [
        pytest.param(code, id=f"{row[0].strip()} {number}")
        for row in ROWS
        for number, code in enumerate(re.findall(r"`([^`]+)`", row[1]))
        if any(word in code for word in words)
    ]


@pytest.mark.parametrize("code", expressions_of("(snapshots", "(from_covariance", " snapshots)"))
def test_expression_finds_two_known_directions(code):
    # Errors, another wavelength, two axes, and a covariance.
    if any(word in code for word in ("_std_rad", "scale *", "[:, None]", "len(")):
        return
    result = eval(code, names_of_two_sources())
    azimuth = page_names()["azimuth"]
    if isinstance(result, np.ndarray):
        is_peak = np.r_[False, (result[1:-1] > result[:-2]) & (result[1:-1] > result[2:]), False]
        peaks = np.flatnonzero(is_peak)
        found = azimuth[peaks[np.argsort(result[peaks])[-2:]]]
    else:
        found = np.ravel(result.azimuth_rad)
    expected = -DIRECTIONS_RAD if "snapshots.conj()" in code else DIRECTIONS_RAD
    # The spectrum has steps of a degree; two beams of half a wavelength repel each other by less.
    distances = abs(np.subtract.outer(found, expected)).min(axis=1)
    np.testing.assert_array_less(distances, np.radians(1))
    assert len(found) in (1, 2)


@pytest.mark.parametrize("code", expressions_of("dc.maps.range"))
def test_expression_keeps_the_power_of_a_tone(code):
    doppler, sample = np.arange(64)[:, None] * 5 / 64, np.arange(128) * 20 / 128
    tone = np.broadcast_to(3 * np.exp(2j * np.pi * (doppler + sample)), (8, 64, 128))
    result = abs(eval(code, names_with(samples=tone)))
    if "np.blackman" in code:  # symmetric
        assert result.max() == pytest.approx(3, rel=1e-3)
    else:
        assert result.max() == pytest.approx(9 if "map" in code.split("(")[0][9:] else 3, rel=1e-6)
    assert 20 in np.unravel_index(result.argmax(), result.shape)


def ordered_statistic_pfa(factor, n, k):
    """Return Rohling's product (IEEE Trans. AES 19(4), 1983)."""
    i = np.arange(k)
    return np.prod((n - i) / (n - i + factor))


def smallest_of_pfa(factor, n):
    """Return the probability of Gandhi and Kassam for n cells on each side, factor of a mean."""
    i = np.arange(n)
    return 2 * np.sum(scipy.special.comb(n - 1 + i, i) * (2 + factor / n) ** -(n + i))


@pytest.mark.parametrize(
    ("row", "pfa_of_factor"),
    [
        ("cfar_ca_1d", lambda a: (1 + a / 16) ** -16),
        ("ca", lambda a: (1 + a / 16) ** -16),
        ("phased.CFARDetector", lambda a: (1 + a / 16) ** -16),
        ("cago", lambda a: 2 * (1 + a / 8) ** -8.0 - smallest_of_pfa(a, 8)),
        ("caso", lambda a: smallest_of_pfa(a, 8)),
        ("cfar_os_1d", lambda a: ordered_statistic_pfa(a, 16, 12)),
        ("cfar_os_2d", lambda a: ordered_statistic_pfa(a, 11**2 - 9, 84)),
        ("os", lambda a: ordered_statistic_pfa(a, 16, 12)),
        ("os_cfar_threshold", lambda a: ordered_statistic_pfa(a, 32, 24)),
    ],
)
def test_factor_of_row_has_the_false_alarm_probability(row, pfa_of_factor):
    (expressions,) = [columns[1] for columns in ROWS if f"`{row}`" in columns[0]]
    code = re.findall(r"`([^`]+)`", expressions)[0]
    threshold = np.atleast_1d(eval(code, names_with(power=np.ones((64, 128)))))
    middle = threshold[tuple(n // 2 for n in threshold.shape)]
    assert pfa_of_factor(float(middle)) == pytest.approx(1e-6, rel=1e-4)


def swerling_1_pd(snr, pfa, n):
    """Return the probability of Swerling for n summed powers that fluctuate together."""
    threshold = scipy.special.gammainccinv(n, pfa)
    growth = 1 + 1 / (n * snr)
    tail = np.exp(-threshold / (1 + n * snr)) * growth ** (n - 1)
    return scipy.special.gammaincc(n - 1, threshold) + tail * scipy.special.gammainc(
        n - 1, threshold / growth
    )


def swerling_3_pd(snr, threshold, n):
    """Integrate the probability of a steady target over the gamma density of Swerling 3."""
    return scipy.integrate.quad(
        lambda x: (
            scipy.stats.ncx2.sf(2 * threshold, 2 * n, 2 * n * x)
            * scipy.stats.gamma.pdf(x, 2, scale=snr / 2)
        ),
        *(0, 20 * snr),
    )[0]


def coherent_pd(snr, pfa):
    return scipy.stats.norm.sf(scipy.stats.norm.isf(pfa) - np.sqrt(2 * snr))


def range_of_radar_equation_m(p, ratio):
    power = 0.016 * 1e2 * (p["c"] / p["f_hz"]) ** 2 * 10 / (4 * np.pi) ** 3
    return (power / (ratio * scipy.constants.k * 290 * 16 * 10e6)) ** 0.25


WINDOWS = scipy.signal.windows


@pytest.mark.parametrize(
    ("row", "number", "expected"),
    [
        ("roc_pd", 0, lambda _: swerling_1_pd(20.0, 1e-6, 4)),
        ("roc_pd", 1, lambda _: coherent_pd(20.0, 1e-6)),
        ("threshold", 0, lambda _: scipy.special.gammainccinv(4, 1e-6)),
        ("marcumq", 0, lambda _: swerling_3_pd(20.0, 13.8, 4)),
        ("log_factorial", 0, lambda _: np.log(np.cumprod(np.arange(1.0, 9)))),
        ("range_resolution", 0, lambda p: p["c"] / (2 * 40e12 * 25.6e-6)),
        ("doppler_resolution", 0, lambda p: p["c"] / p["f_hz"] / (2 * 64 * 88e-6)),
        ("rocsnr", 0, lambda _: swerling_1_pd(20.0, np.logspace(-10, -1), 4)),
        ("radareqrng", 0, lambda p: range_of_radar_equation_m(p, 20.0 / 1e4)),
        ("radareqpow", 0, lambda p: 0.016 * (50 / range_of_radar_equation_m(p, 20.0)) ** 4),
        (
            "crlb",
            0,
            # Variance of a frequency, 6 / (SNR (N^2 - 1)) rad^2 (Rife and Boorstyn, 1974).
            lambda p: p["c"] / 80e12 * 10e6 / (2 * np.pi) * np.sqrt(6 / (20 * (256**2 - 1))),
        ),
        (
            "crlb",
            1,
            lambda p: 0.0039 / 2 / (2 * np.pi * 88e-6) * np.sqrt(6 / (20 * (64**2 - 1))),
        ),
        ("chebwin", 0, lambda _: WINDOWS.chebwin(64, 60)),
        ("chebwin", 1, lambda _: WINDOWS.taylor(64, 4, 30)),
        ("chebwin", 2, lambda _: WINDOWS.kaiser(64, 6)),
        ("chebwin", 3, lambda _: WINDOWS.hann(64, sym=False)),
        ("ospa", 0, lambda _: 0.5),
        ("AWGN", 0, lambda _: scipy.constants.k * 290 * 10e6),
        ("fspl", 0, lambda p: 20 * np.log10(4 * np.pi * 50 * p["f_hz"] / p["c"])),
    ],
)
def test_expression_equals_closed_form(row, number, expected):
    names = page_names()
    (expressions,) = [columns[1] for columns in ROWS if f"`{row}`" in columns[0]]
    value = eval(re.findall(r"`([^`]+)`", expressions)[number], names)
    np.testing.assert_allclose(value, expected(names), rtol=2e-5)


@pytest.mark.parametrize(("row", "probability"), [("roc_snr", 0.9), ("detectability", 0.9)])
def test_required_snr_gives_the_probability(row, probability):
    (expressions,) = [columns[1] for columns in ROWS if f"`{row}`" in columns[0]]
    values = [eval(code, page_names()) for code in re.findall(r"`([^`]+)`", expressions)]
    snr = 10 ** (values[0] / 10) if row == "detectability" else values[0]
    assert swerling_1_pd(float(snr), 1e-6, 4) == pytest.approx(probability, rel=1e-6)
    for coherent in values[1:]:
        assert coherent_pd(coherent, 1e-6) == pytest.approx(probability, rel=1e-6)


WAVEFORM = {"slope_hz_per_s": 30e6 / 2e-3}
PULSE_1_US, PULSE_10_US = ({"noise_factor": 1.0, "sample_rate_hz": rate} for rate in (1e6, 1e5))
GAIN_20_DB = {"tx_gain": 100.0, "rx_gain": 100.0}
AT_300_K = {"noise_factor": 300 / 290, "sample_rate_hz": 1e6, "loss": 10**0.3}


def decibels(ratio):
    return 10 * np.log10(ratio)


def power_of_snr(snr_db, *arguments, **settings):
    """Return the power that gives the SNR, as in the row of `radareqpow`."""
    snr = dc.link_budget.sample_snr(*arguments, transmit_power_w=1.0, **settings)
    return 10 ** (snr_db / 10) / snr


@pytest.mark.parametrize(
    ("documented", "value"),
    [
        # Results of the examples in MATLAB's reference pages, release R2026a.
        pytest.param(9.9931, dc.link_budget.range_from_beat(1e3, **WAVEFORM), id="beat2range"),
        pytest.param(
            36.0249,
            dc.link_budget.beat_frequency(18e3, slope_hz_per_s=300e6 / 1e-3) / 1e6,
            id="range2beat",
        ),
        pytest.param(
            2.8807e3,
            dc.link_budget.beat_frequency(
                0, slope_hz_per_s=0, velocity_m_per_s=35.76, frequency_hz=24.15e9
            )
            / 2,  # one way; the beat frequency grows when receding
            id="speed2dop",
        ),
        pytest.param(
            5.5868,
            decibels(
                dc.link_budget.sample_snr(
                    *(50e3, 1.0),
                    transmit_power_w=1e6,
                    frequency_hz=1e9,
                    noise_factor=1.0,
                    sample_rate_hz=5e6,
                    **GAIN_20_DB,
                )
            ),
            id="radareqsnr",
        ),
        pytest.param(
            14.3778,
            decibels(
                dc.link_budget.sample_snr(
                    *(100e3, 0.5),
                    transmit_power_w=1e6,
                    frequency_hz=10e9,
                    tx_gain=1e4,
                    rx_gain=1e4,
                    **AT_300_K,
                )
            ),
            id="radareqsnr at 300 K",
        ),
        pytest.param(
            2.1996e5,
            power_of_snr(6, 50e3, 1.0, frequency_hz=1e9, **PULSE_1_US, **GAIN_20_DB),
            id="radareqpow",
        ),
        pytest.param(
            2.2809e6,
            power_of_snr(10, 50e3, 0.5, frequency_hz=10e9, tx_gain=1e3, rx_gain=1e3, **AT_300_K),
            id="radareqpow at 300 K",
        ),
        pytest.param(
            4.1057e4,
            dc.link_budget.max_range(
                *(10**0.6, 1.0),
                transmit_power_w=1e6,
                frequency_hz=10e9,
                **PULSE_10_US,
                **GAIN_20_DB,
            ),
            id="radareqrng",
        ),
        pytest.param(
            1.9426e5,
            dc.link_budget.max_range(
                *(10**0.6, 0.1),
                transmit_power_w=1e6,
                frequency_hz=10e9,
                tx_gain=1e4,
                rx_gain=1e4,
                loss=10**0.3,
                **PULSE_10_US,
            ),
            id="radareqrng with loss",
        ),
    ],
)
def test_value_of_matlab_documentation(documented, value):
    # Five digits are printed.
    assert float(value) == pytest.approx(documented, rel=5e-5)


def half_power_phase(n_elements):
    """Return half the phase from element to element at which an array has half its power."""
    return scipy.optimize.brentq(
        lambda phase: (np.sin(n_elements * phase) / (n_elements * np.sin(phase))) ** 2 - 0.5,
        *(1e-3, np.pi / n_elements),
    )


def shnidman_db(pd, pfa, n):
    """Return Shnidman's equation for a steady target, of his paper (IEEE Trans. AES 38(3))."""
    eta = np.sqrt(-0.8 * np.log(4 * pfa * (1 - pfa)))
    eta += np.sign(pd - 0.5) * np.sqrt(-0.8 * np.log(4 * pd * (1 - pd)))
    alpha = 0.0 if n < 40 else 0.25
    return decibels(eta * (eta + 2 * np.sqrt(n / 2 + alpha - 0.25)) / n)


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("range2beat", lambda p: 2 * 50.0 * p["slope"] / p["c"]),
        ("beat2range", lambda p: 1e6 * p["c"] / (2 * p["slope"])),
        ("rangeres2bw", lambda p: p["c"] / (2 * 0.15)),
        ("speed2dop", lambda p: 2 * 10 * p["f_hz"] / p["c"]),
        ("dop2speed", lambda p: 1e3 * p["c"] / p["f_hz"] / 2),
        ("rdcoupling", lambda p: 1e3 * p["c"] / (2 * p["slope"])),
        ("npwgnthresh", lambda p: decibels(scipy.special.gammainccinv(4, 1e-6))),
        (
            "radareqsnr",
            lambda p: (
                0.016
                * 1e2
                * (p["c"] / p["f_hz"]) ** 2
                * 10
                / ((4 * np.pi) ** 3 * 50**4)
                / (scipy.constants.k * 290 * 16 * 10e6)
            ),
        ),
        ("noisepow", lambda _: scipy.constants.k * 290 * 16 * 10e6),
        ("stretchfreq2rng", lambda p: 1e6 * p["c"] / (2 * p["slope"])),
        ("enbw", lambda _: 1.5),
        ("fspl", lambda p: 20 * np.log10(4 * np.pi * 50 * p["f_hz"] / p["c"])),
        ("beamwidth", lambda _: 2 * np.arcsin(half_power_phase(8) / (np.pi * 0.5))),
    ],
)
def test_row_of_matlab_equals_its_documented_formula(row, expected):
    names = page_names()
    (expressions,) = [columns[1] for columns in ROWS if f"`{row}`" in columns[0]]
    value = eval(re.findall(r"`([^`]+)`", expressions)[0], names)
    assert float(value) == pytest.approx(float(expected(names)), rel=1e-6)


@pytest.mark.parametrize("n", [1, 10, 50])
def test_albersheim_and_shnidman_equal_their_papers(n):
    a, b = np.log(0.62e6), np.log(9.0)
    albersheim = -5 * np.log10(n) + (6.2 + 4.54 / np.sqrt(n + 0.44)) * np.log10(
        a + 0.12 * a * b + 1.7 * b
    )
    assert decibels(dc.theory.albersheim(0.9, 1e-6, n_summed=n)) == pytest.approx(albersheim)
    shnidman = decibels(dc.theory.shnidman(0.9, 1e-6, n_summed=n))
    assert shnidman == pytest.approx(shnidman_db(0.9, 1e-6, n))
