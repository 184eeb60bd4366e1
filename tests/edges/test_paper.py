"""Paper of a certificate: self-contained page whose numbers come from its document."""

import json
import math
import re
from copy import deepcopy
from importlib.resources import files

import pytest

from dechirp.certificate import paper
from dechirp.certificate.certificate import CLAIM_IDS, Certificate
from dechirp.certificate.claim import Check, Claim
from dechirp.certificate.corrections import list_corrections_of_published_report
from dechirp.certificate.detection_curves import MeasuredCurve
from dechirp.certificate.document import certificate_as_json_data
from dechirp.certificate.paper import REFERENCES, resolve_labels_and_citations
from dechirp.certificate.paper_figures import draw_paper_figures
from dechirp.certificate.tables import build_report_tables
from dechirp.report.check_values import (
    apply_typography,
    format_amount,
    format_check_row,
    format_count,
    format_pair,
)
from dechirp.report.equations import equation_svg, typeset_equations
from nightly import nightly
from page_checks import check_captions, check_pdf_contains_page_text

MINUS, DASH, TIMES = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"
FIGURE_NAMES = {
    "data_flow",
    "frequencies",
    "demodulator",
    "window",
    "spectrogram",
    "spectrum",
    "map",
    "noisy_map",
    "detections",
    "detectors",
    "thresholds",
    "curves",
    "resolution",
}


def make_ratio_check(name: str, measured: float = 1.0, **fields) -> Check:
    return Check(
        name=name,
        unit="1",
        measured=measured,
        low=measured - 0.03,
        high=measured,
        at_least=0.9,
        trials=1000,
        **fields,
    )


def make_db_check(name: str, measured: float, **fields) -> Check:
    return Check(
        name=name, unit="dB", measured=measured, low=measured - 0.1, high=measured + 0.1, **fields
    )


CHECKS = {
    "chirp_linearity": (
        Check(
            name="slope",
            unit="Hz/s",
            published=2.045e13,
            measured=2.0454545e13,
            at_least=2.0454525e13,
            at_most=2.0454565e13,
            limit=2.0454545e13,
        ),
    ),
    "range_doppler_peak": (
        Check(
            name="mean range at -10 dB",
            unit="m",
            published=49.98,
            measured=50.00472,
            low=50.00454,
            high=50.0049,
            at_least=50.004,
            at_most=50.0054,
            limit=50.00469,
            trials=2996,
        ),
        Check(name="mean velocity at -10 dB", unit="m/s", published=9.94, measured=10.0001),
    ),
    "echo_power_50m": (
        Check(
            name="mean power",
            unit="W",
            published="picowatts",
            measured=1.93e-12,
            at_least=1e-12,
            at_most=1e-9,
            limit=1.93e-12,
        ),
    ),
    "snr_limit": (
        make_db_check("rectangular windows", -40.7, published=-24.0, at_most=-40.5, limit=-40.75),
        make_db_check("Hann windows", -37.4, at_most=-37.0, limit=-37.42),
        make_db_check("the report's rule, for comparison", -24.1, limit=-24.41),
    ),
    "range_rmse": (Check(name="error", unit="m", measured=0.0117, at_most=0.0134, limit=0.0116),),
    "velocity_rmse": (
        Check(name="error", unit="m/s", measured=0.0242, at_most=0.0277, limit=0.0241),
    ),
}


@pytest.fixture(scope="module")
def document() -> dict:
    claims = {
        name: Claim(
            id=name,
            claim=f"A claim called {name.replace('_', ' ')}.",
            checks=CHECKS.get(name, (make_ratio_check("share"), make_ratio_check("another"))),
            note="A note with 1e-6 in it.",
        )
        for name in CLAIM_IDS
    }
    pairs = {"x_label": "Separation (range bins)", "x": (1.0, 1.5), "trials": (100, 1000)}
    frames = {"x_label": "SNR per sample (dB)", "trials": (500, 500), "hits": (200, 480)}
    content = certificate_as_json_data(
        Certificate(
            claims=tuple(claims.values()),
            corrections=list_corrections_of_published_report(),
            tables=build_report_tables(claims),
            curves=(
                MeasuredCurve(
                    name="rectangular windows",
                    x=(-42.0, -40.0),
                    theory_x=(-43.0, -39.0),
                    theory=(0.3, 0.99),
                    **frames,
                ),
                MeasuredCurve(
                    name="the report's rule",
                    x=(-24.5, -24.0),
                    theory_x=(-25.0, -23.0),
                    theory=(0.1, 1.0),
                    **frames,
                ),
                MeasuredCurve(name="rectangular windows", hits=(60, 1000), **pairs),
                MeasuredCurve(name="Hann windows", hits=(35, 610), **pairs),
            ),
            seed=3,
            trials=None,
            full=False,
            date="2026-02-03T04:05:06+00:00",
            versions={"python": "3.11.0", "numpy": "2.0.0"},
            machine="a machine, 2 cores",
            timing_s={"trials": 100.0, "claims": 1.0},
        )
    )
    content["numbers"]["measured_false_alarm_probabilities"] = [1e-4, 1e-6]
    return {"version": "0.1.0", **content}


@pytest.fixture(scope="module")
def figures(document) -> dict:
    return draw_paper_figures(document)


@pytest.fixture
def render_page(monkeypatch, figures):
    """Return the renderer with precomputed figures, which take most of the time."""
    monkeypatch.setattr(paper, "draw_paper_figures", lambda document: figures)
    return paper.render_paper


@pytest.fixture
def page(render_page, document) -> str:
    return render_page(document)


def extract_text(page: str) -> str:
    """Return the visible text of a page, without formulas and figures."""
    for part in (r"<style>.*?</style>", r"<svg.*?</svg>", r"<[^>]*>"):
        page = re.sub(part, " ", page, flags=re.DOTALL)
    return " ".join(page.replace("\N{NO-BREAK SPACE}", " ").split())


@nightly
def test_paper_loads_no_external_resources(page):
    resources = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?\s*([^"')> ]+)""", page)
    assert all(resource.startswith(("#", "data:")) for resource in resources)
    assert page.count("<script") == 1 and "@import" not in page and "<link" not in page
    assert "http:" not in page and "https:" not in page
    assert len(page.encode()) < 3_000_000


@nightly
def test_figures_have_captions(page):
    check_captions(page)


@nightly  # the layout takes six seconds
def test_pdf_contains_all_text(page):
    check_pdf_contains_page_text(page)


def test_all_links_of_paper_resolve(page):
    # Figures are removed: equal SVG shapes have equal ids.
    page = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    anchors = re.findall(r'\bid="([^"]+)"', page)
    assert len(anchors) == len(set(anchors))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(anchors)


def test_paper_has_sections_figures_and_tables_in_order(page, figures):
    assert re.findall(r'<section id="(\w+)"', page) == [
        "introduction",
        "method",
        "results",
        "corrections",
        "discussion",
        "repeat",
        "references",
    ]
    assert set(figures) == FIGURE_NAMES
    assert all(str(figure) in page for figure in figures.values())
    figure_numbers = re.findall(r'<b id="figure-\w+">Figure (\d+)', page)
    assert figure_numbers == [str(number) for number in range(1, len(FIGURE_NAMES) + 1)]
    assert re.findall(r'<b id="table-\w+">Table (\d+)', page) == [str(n) for n in range(1, 7)]
    for number in (5, 6, 7):
        assert f"(table {number} of the report)" in page


def test_references_are_numbered_by_first_citation_and_all_are_cited(page):
    citations = re.findall(r'<a href="#ref-[\w-]+">(\d+)</a>', page)
    assert list(dict.fromkeys(citations)) == [str(n) for n in range(1, len(REFERENCES) + 1)]
    assert page.count('<li id="ref-') == len(REFERENCES)


def test_template_contains_no_numbers():
    text = files("dechirp.certificate").joinpath("paper.html").read_text(encoding="utf-8")
    for part in (
        r"<style>.*?</style>",
        r"\{%.*?%\}",
        r"\{\{.*?\}\}",
        r"\\\[.*?\\\]",  # equations, and formulas in the line
        r"\\\(.*?\\\)",
        r"\\\w+\{.*?\}",  # labels, citations
        r"<[^>]*>",
    ):
        text = re.sub(part, " ", text, flags=re.DOTALL)
    assert re.findall(r"\S*\d\S*", text) == []


def test_numbers_in_text_come_from_document(page, render_page, document):
    for number in (f"{MINUS}40.70 dB", f"{MINUS}24.10 dB", "6.823 MHz", "54.50 dB", "13.96"):
        assert number in extract_text(page)
    changed_document = deepcopy(document)
    changed_document["claims"][CLAIM_IDS.index("snr_limit")]["checks"][0]["measured"] = -40.123
    changed_document["numbers"]["beat_frequency_hz"] = 7.654321e6
    changed_document["numbers"]["factor"] = 98.76
    changed_document["seed"] = 4321
    text = extract_text(render_page(changed_document))
    for number in (f"{MINUS}40.12 dB", "7.654 MHz", "98.76", "--seed 4321"):
        assert number in text
    assert f"{MINUS}40.70 dB per sample" not in text and "6.823 MHz" not in text


def test_abstract_states_false_alarm_rates_and_windows(render_page, document):
    changed_document = deepcopy(document)
    changed_document["claims"][CLAIM_IDS.index("two_targets_resolved")]["checks"][1]["measured"] = (
        0.75
    )
    abstract = re.search(
        r'<div class="abstract">.*?</div>', render_page(changed_document), re.DOTALL
    )[0]
    assert f"<sup>{MINUS}4</sup> and 10<sup>{MINUS}6</sup> per cell" in abstract
    counts = re.search(
        r"in (.{0,20}) trials with rect.* in (.{0,20}) with Hann", extract_text(abstract)
    )
    assert [text.replace(" ", "") for text in counts.groups()] == ["1000of1000", "750of1000"]


def test_paper_states_size_of_neglected_echo_terms(page):
    text = extract_text(page)
    assert f"3.34 {TIMES} 10 {MINUS}8" in text  # 10 m/s over c
    assert "without approximation" not in text and "exact phase" not in text


def test_introduction_states_secondary_source_and_rebuilt_detector(page):
    introduction = extract_text(
        re.search(r'<section id="introduction">.*?</section>', page, re.DOTALL)[0]
    )
    assert "known only from a summary" in introduction
    assert "31.6 times the mean amplitude" in introduction
    assert "the report’s range, 49.98 m" in introduction  # noqa: RUF001


def test_both_maps_share_scale_over_noise(figures):
    quiet, noisy = (
        re.findall(r"<text[^>]*>([^<]*)</text>", figures[name]) for name in ("map", "noisy_map")
    )
    assert quiet == noisy
    assert "Power over mean noise (dB)" in quiet
    # -10 dB, 54.5 dB of gain, 3.5 dB of window loss (Hann): the scale ends at about 41 dB.
    assert "40" in quiet and f"{MINUS}100" in quiet


def test_passed_certificate_names_no_failure(page):
    assert "<title>16 of 16 claims hold" in page
    assert "All 16 claims hold" in re.search(r"<h1>.*?</h1>", page, re.DOTALL)[0]
    assert "FAIL" not in page and "NOT CERTIFIED" not in page
    assert 'class="bad"' not in page


def test_failed_claim_appears_in_title_abstract_and_tables(render_page, document):
    failed_document = deepcopy(document)
    claim = failed_document["claims"][CLAIM_IDS.index("range_rmse")]
    claim["passed"] = claim["checks"][0]["passed"] = failed_document["passed"] = False
    page = render_page(failed_document)

    assert "<title>FAILED: 15 of 16 claims hold" in page
    assert "NOT CERTIFIED: 1 of 16 claims fails" in re.search(r"<h1>.*?</h1>", page, re.DOTALL)[0]
    abstract = re.search(r'<div class="abstract">.*?</div>', page, re.DOTALL)[0]
    assert "1 of 16 claims fails: range_rmse" in extract_text(abstract).replace(" .", ".")
    assert "All 16" not in page
    rows = re.findall(r'<tr class="bad">.*?</tr>', page)
    assert len(rows) == 2  # in the table of claims, and in that of checks
    assert all(">FAILS</td>" in row for row in rows)


def test_several_failed_claims_are_all_named(render_page, document):
    failed_document = deepcopy(document)
    for name in ("snr_limit", "corner_200m_100mps"):
        failed_document["claims"][CLAIM_IDS.index(name)]["passed"] = False
    assert "2 of 16 claims fail: corner_200m_100mps , snr_limit" in extract_text(
        render_page(failed_document)
    )


@nightly
@pytest.mark.parametrize("missing_value", [None, math.nan])
def test_missing_measurements_do_not_stop_paper(document, missing_value):
    bare_document = json.loads(json.dumps(document))
    for claim in bare_document["claims"]:
        for entry in (claim, *claim["checks"]):
            entry.update(published=None, limit=None, interval=None, trials=None, passed=False)
            entry["measured"] = missing_value
        claim["note"] = ""
    for table in bare_document["tables"]:
        for row in table["rows"]:
            row["computed"] = None

    page = paper.render_paper(bare_document)

    assert "NOT CERTIFIED: 16 of 16" in page
    assert "nan" not in extract_text(page).lower().replace("nanosecond", "")


def test_text_of_document_is_escaped(render_page, document):
    hostile_document = deepcopy(document)
    hostile_document["claims"][0]["claim"] = hostile_document["claims"][0]["note"] = (
        "<script>alert(1)</script>"
    )
    hostile_document["machine"] = "{{ 7 * 7 }} <b>"
    page = render_page(hostile_document)
    assert page.count("<script") == 1  # the script of the paper
    assert "{{ 7 * 7 }} &lt;b&gt;" in page


def test_same_document_gives_same_paper(document, page):
    assert paper.render_paper(document) == page


def test_figures_are_annotated_with_numbers_of_document(figures):
    assert "644 training cells" in figures["window"] and "80 guard cells" in figures["window"]
    assert "6.823 MHz" in figures["frequencies"] and "333.6 ns" in figures["frequencies"]
    assert "16.6 dB" in figures["curves"]  # from -40.7 to -24.1 dB
    assert f"{MINUS}32.4 dB" in figures["detections"]  # half way between the two
    for figure in figures.values():
        assert re.match(r'<svg [^>]*role="img" aria-label="[^"]+"', figure)


def test_interval_sets_number_of_digits():
    check = CHECKS["range_doppler_peak"][0]
    texts = format_check_row(
        {
            "unit": check.unit,
            "measured": check.measured,
            "published": check.published,
            "limit": check.limit,
            "required": {"at_least": check.at_least, "at_most": check.at_most},
            "interval": [check.low, check.high],
        }
    )
    assert texts.measured.split() == ["50.00472", "m"]
    assert texts.interval == "50.00454 to 50.00490"
    assert texts.required.split() == ["50.0040", "to", "50.0054", "m"]
    assert texts.published.split() == ["49.98", "m"]


def test_requirements_are_formatted_with_relation_sign():
    check = {"unit": "dB", "measured": -40.7, "published": None, "limit": None, "interval": None}
    assert format_check_row({**check, "required": {"at_most": -40.5}}).required.startswith(
        f"≤ {MINUS}40.5"
    )
    assert format_check_row({**check, "required": {"at_least": -60.0}}).required.startswith(
        f"≥ {MINUS}60"
    )
    assert (
        format_check_row({**check, "required": {"at_least": 0.0, "at_most": 0.0}}).required.split()[
            0
        ]
        == "0"
    )
    assert format_check_row({**check, "required": None}).required == DASH


def test_amounts_are_formatted_with_readable_units():
    assert format_amount(6.8229e6, "Hz").split() == ["6.823", "MHz"]
    assert format_amount(2.0454545e13, "Hz/s").split() == ["2.045", TIMES, "10¹³", "Hz/s"]
    assert format_amount(1.93e-12, "W").split() == ["1.93", "pW"]
    assert format_amount(0.0376811, "m") == "37.68 mm"
    assert format_amount(0.9, "1") == "0.9"
    assert format_amount(None, "m") == DASH
    assert format_count(100249600).split() == ["100", "249", "600"]


def test_pair_of_values_is_formatted_with_digits_of_their_difference():
    assert [text.split() for text in format_pair(49.98, 50.0047196, "m")] == [
        ["49.98", "m"],
        ["50.0047", "m"],
    ]
    assert format_pair(2200, 2200, "1") == ("2200", "2200")
    assert format_pair(None, 2.07, "m/s")[0] == DASH


def test_plain_text_gets_typographic_signs():
    assert apply_typography("at -24 dB and 1e-06, not 2.045e+13") == (
        f"at {MINUS}24 dB and 10⁻⁶, not 2.045 {TIMES} 10¹³"
    )
    assert apply_typography('10^-341 of "that" is the report\'s') == (
        "10⁻³⁴¹ of “that” is the report’s"  # noqa: RUF001
    )
    assert apply_typography("2-D, range-Doppler, 9-10") == "2-D, range-Doppler, 9-10"


def test_formula_svg_is_aligned_to_baseline_and_labelled():
    upright_svg, deep_svg = equation_svg("R"), equation_svg("f_0")
    assert 'aria-label="f_0"' in deep_svg

    def read_vertical_offset_em(formula: str) -> float:
        return float(re.search(r"vertical-align:(-?[\d.]+)em", formula)[1])

    assert abs(read_vertical_offset_em(upright_svg)) < 0.03
    assert read_vertical_offset_em(deep_svg) < -0.1
    assert "{" not in equation_svg(r"\frac{1}{2}")


def test_equations_are_numbered_in_order():
    text = typeset_equations(r"\[one| a = b \] then \[two| c \], \eqref{two} after \eqref{one}")
    assert re.findall(r"<i>\((\d)\)</i>", text) == ["1", "2"]
    assert text.index('href="#eq-two">(2)') < text.index('href="#eq-one">(1)')


@pytest.mark.parametrize("text", [r"\ref{figure:nowhere}", r"\cite{nobody}"])
def test_unknown_reference_raises_error(text):
    with pytest.raises(KeyError):
        resolve_labels_and_citations(text, REFERENCES)


def test_unknown_equation_reference_raises_error():
    with pytest.raises(KeyError):
        typeset_equations(r"\eqref{nothing}")
