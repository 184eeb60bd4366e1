"""The paper of a certificate: one page that stands alone and says what its document says."""

import json
import math
import re
from copy import deepcopy
from importlib.resources import files

import pytest

from dechirp.certificate import paper
from dechirp.certificate.certificate import CLAIM_IDS, Certificate
from dechirp.certificate.claim import Check, Claim
from dechirp.certificate.corrections import find_corrections
from dechirp.certificate.detection_curves import MeasuredCurve
from dechirp.certificate.document import build_document as document_of
from dechirp.certificate.paper import REFERENCES, number_references
from dechirp.certificate.paper_figures import draw_figures
from dechirp.certificate.tables import build_tables
from dechirp.report.check_values import (
    apply_typography,
    format_amount,
    format_check,
    format_count,
    format_pair,
)
from dechirp.report.equations import equation_svg, typeset_equations
from printed import check_captions, check_pdf

MINUS, DASH, TIMES = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{MULTIPLICATION SIGN}"
FIGURES = {
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


def share(name: str, measured: float = 1.0, **told) -> Check:
    return Check(
        name=name,
        unit="1",
        measured=measured,
        low=measured - 0.03,
        high=measured,
        at_least=0.9,
        trials=1000,
        **told,
    )


def limit_db(name: str, measured: float, **told) -> Check:
    return Check(
        name=name, unit="dB", measured=measured, low=measured - 0.1, high=measured + 0.1, **told
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
        limit_db("rectangular windows", -40.7, published=-24.0, at_most=-40.5, limit=-40.75),
        limit_db("Hann windows", -37.4, at_most=-37.0, limit=-37.42),
        limit_db("the report's rule, for comparison", -24.1, limit=-24.41),
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
            checks=CHECKS.get(name, (share("share"), share("another"))),
            note="A note with 1e-6 in it.",
        )
        for name in CLAIM_IDS
    }
    pairs = {"x_label": "Separation (range bins)", "x": (1.0, 1.5), "trials": (100, 1000)}
    frames = {"x_label": "SNR per sample (dB)", "trials": (500, 500), "hits": (200, 480)}
    made = document_of(
        Certificate(
            claims=tuple(claims.values()),
            corrections=find_corrections(),
            tables=build_tables(claims),
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
    made["numbers"]["measured_false_alarm_probabilities"] = [1e-4, 1e-6]
    return {"version": "0.1.0", **made}


@pytest.fixture(scope="module")
def drawn(document) -> dict:
    return draw_figures(document)


@pytest.fixture
def page_of(monkeypatch, drawn):
    """Render with the figures of the sound document: they take most of the time."""
    monkeypatch.setattr(paper, "draw_figures", lambda document: drawn)
    return paper.render_paper


@pytest.fixture
def page(page_of, document) -> str:
    return page_of(document)


def words(page: str) -> str:
    """Text of a page as a reader sees it, formulas and figures left out."""
    for part in (r"<style>.*?</style>", r"<svg.*?</svg>", r"<[^>]*>"):
        page = re.sub(part, " ", page, flags=re.DOTALL)
    return " ".join(page.replace("\N{NO-BREAK SPACE}", " ").split())


def test_the_paper_asks_nothing_of_any_other_place(page):
    outside = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?\s*([^"')> ]+)""", page)
    assert all(place.startswith(("#", "data:")) for place in outside)
    assert page.count("<script") == 1 and "@import" not in page and "<link" not in page
    assert "http:" not in page and "https:" not in page
    assert len(page.encode()) < 3_000_000


def test_every_figure_says_what_to_see_and_the_pdf_says_all_of_the_paper(page):
    check_captions(page)
    check_pdf(page)


def test_every_link_of_the_paper_leads_somewhere(page):
    # Equal shapes have equal names in the figures, whichever of them is meant.
    page = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    places = re.findall(r'\bid="([^"]+)"', page)
    assert len(places) == len(set(places))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(places)


def test_the_paper_has_all_its_parts_in_order(page, drawn):
    assert re.findall(r'<section id="(\w+)"', page) == [
        "introduction",
        "method",
        "results",
        "corrections",
        "discussion",
        "repeat",
        "references",
    ]
    assert set(drawn) == FIGURES
    assert all(str(figure) in page for figure in drawn.values())
    figures = re.findall(r'<b id="figure-\w+">Figure (\d+)', page)
    assert figures == [str(number) for number in range(1, len(FIGURES) + 1)]
    assert re.findall(r'<b id="table-\w+">Table (\d+)', page) == [str(n) for n in range(1, 7)]
    for number in (5, 6, 7):
        assert f"(table {number} of the report)" in page


def test_references_are_numbered_as_they_are_first_cited_and_none_is_idle(page):
    cited = re.findall(r'<a href="#ref-[\w-]+">(\d+)</a>', page)
    assert list(dict.fromkeys(cited)) == [str(n) for n in range(1, len(REFERENCES) + 1)]
    assert page.count('<li id="ref-') == len(REFERENCES)


def test_the_template_holds_no_number_of_its_own():
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


def test_the_numbers_of_the_text_are_those_of_the_document(page, page_of, document):
    for number in (f"{MINUS}40.70 dB", f"{MINUS}24.10 dB", "6.823 MHz", "54.50 dB", "13.96"):
        assert number in words(page)
    other = deepcopy(document)
    other["claims"][CLAIM_IDS.index("snr_limit")]["checks"][0]["measured"] = -40.123
    other["numbers"]["beat_frequency_hz"] = 7.654321e6
    other["numbers"]["factor"] = 98.76
    other["seed"] = 4321
    text = words(page_of(other))
    for number in (f"{MINUS}40.12 dB", "7.654 MHz", "98.76", "--seed 4321"):
        assert number in text
    assert f"{MINUS}40.70 dB per sample" not in text and "6.823 MHz" not in text


def test_the_abstract_says_at_which_rate_and_under_which_windows(page_of, document):
    other = deepcopy(document)
    other["claims"][CLAIM_IDS.index("two_targets_resolved")]["checks"][1]["measured"] = 0.75
    abstract = re.search(r'<div class="abstract">.*?</div>', page_of(other), re.DOTALL)[0]
    assert f"<sup>{MINUS}4</sup> and 10<sup>{MINUS}6</sup> per cell" in abstract
    counts = re.search(r"in (.{0,20}) trials with rect.* in (.{0,20}) with Hann", words(abstract))
    assert [text.replace(" ", "") for text in counts.groups()] == ["1000of1000", "750of1000"]


def test_what_the_echoes_leave_out_is_said_with_its_size(page):
    text = words(page)
    assert f"3.34 {TIMES} 10 {MINUS}8" in text  # 10 m/s over c
    assert "without approximation" not in text and "exact phase" not in text


def test_the_report_is_known_at_second_hand_and_its_rebuilt_detector_is_described(page):
    introduction = words(re.search(r'<section id="introduction">.*?</section>', page, re.DOTALL)[0])
    assert "known only from a summary" in introduction
    assert "31.6 times the mean amplitude" in introduction
    assert "the report’s range, 49.98 m" in introduction  # noqa: RUF001


def test_the_two_maps_have_one_scale_over_their_noise(drawn):
    quiet, noisy = (
        re.findall(r"<text[^>]*>([^<]*)</text>", drawn[name]) for name in ("map", "noisy_map")
    )
    assert quiet == noisy
    assert "Power over mean noise (dB)" in quiet
    # -10 dB, 54.5 dB of gain, 3.5 dB of Hann windows: the scale ends at about 41 dB.
    assert "40" in quiet and f"{MINUS}100" in quiet


def test_where_all_holds_the_paper_says_so_and_names_no_failure(page):
    assert "<title>16 of 16 claims hold" in page
    assert "All 16 claims hold" in re.search(r"<h1>.*?</h1>", page, re.DOTALL)[0]
    assert "FAIL" not in page and "NOT CERTIFIED" not in page
    assert 'class="bad"' not in page


def test_a_failed_claim_cannot_be_overlooked(page_of, document):
    bad = deepcopy(document)
    claim = bad["claims"][CLAIM_IDS.index("range_rmse")]
    claim["passed"] = claim["checks"][0]["passed"] = bad["passed"] = False
    page = page_of(bad)

    assert "<title>FAILED: 15 of 16 claims hold" in page
    assert "NOT CERTIFIED: 1 of 16 claims fails" in re.search(r"<h1>.*?</h1>", page, re.DOTALL)[0]
    abstract = re.search(r'<div class="abstract">.*?</div>', page, re.DOTALL)[0]
    assert "1 of 16 claims fails: range_rmse" in words(abstract).replace(" .", ".")
    assert "All 16" not in page
    rows = re.findall(r'<tr class="bad">.*?</tr>', page)
    assert len(rows) == 2  # in the table of claims, and in that of checks
    assert all(">FAILS</td>" in row for row in rows)


def test_several_failed_claims_are_all_named(page_of, document):
    bad = deepcopy(document)
    for name in ("snr_limit", "corner_200m_100mps"):
        bad["claims"][CLAIM_IDS.index(name)]["passed"] = False
    assert "2 of 16 claims fail: corner_200m_100mps , snr_limit" in words(page_of(bad))


@pytest.mark.parametrize("nothing", [None, math.nan])
def test_what_was_not_measured_has_a_dash_and_stops_nothing(document, nothing):
    bare = json.loads(json.dumps(document))
    for claim in bare["claims"]:
        for one in (claim, *claim["checks"]):
            one.update(published=None, limit=None, interval=None, trials=None, passed=False)
            one["measured"] = nothing
        claim["note"] = ""
    for table in bare["tables"]:
        for row in table["rows"]:
            row["computed"] = None

    page = paper.render_paper(bare)

    assert "NOT CERTIFIED: 16 of 16" in page
    assert "nan" not in words(page).lower().replace("nanosecond", "")


def test_words_of_the_document_stay_text(page_of, document):
    hostile = deepcopy(document)
    hostile["claims"][0]["claim"] = hostile["claims"][0]["note"] = "<script>alert(1)</script>"
    hostile["machine"] = "{{ 7 * 7 }} <b>"
    page = page_of(hostile)
    assert page.count("<script") == 1  # our own
    assert "{{ 7 * 7 }} &lt;b&gt;" in page


def test_the_same_document_gives_the_same_paper(document, page):
    assert paper.render_paper(document) == page


def test_figures_are_annotated_with_the_numbers_of_the_document(drawn):
    assert "644 training cells" in drawn["window"] and "80 guard cells" in drawn["window"]
    assert "6.823 MHz" in drawn["frequencies"] and "333.6 ns" in drawn["frequencies"]
    assert "16.6 dB" in drawn["curves"]  # from -40.7 to -24.1 dB
    assert f"{MINUS}32.4 dB" in drawn["detections"]  # half way between the two
    for figure in drawn.values():
        assert re.match(r'<svg [^>]*role="img" aria-label="[^"]+"', figure)


def test_the_interval_decides_on_the_digits():
    told = CHECKS["range_doppler_peak"][0]
    made = format_check(
        {
            "unit": told.unit,
            "measured": told.measured,
            "published": told.published,
            "limit": told.limit,
            "required": {"at_least": told.at_least, "at_most": told.at_most},
            "interval": [told.low, told.high],
        }
    )
    assert made.measured.split() == ["50.00472", "m"]
    assert made.interval == "50.00454 to 50.00490"
    assert made.required.split() == ["50.0040", "to", "50.0054", "m"]
    assert made.published.split() == ["49.98", "m"]


def test_a_requirement_is_written_as_it_is_meant():
    check = {"unit": "dB", "measured": -40.7, "published": None, "limit": None, "interval": None}
    assert format_check({**check, "required": {"at_most": -40.5}}).required.startswith(
        f"≤ {MINUS}40.5"
    )
    assert format_check({**check, "required": {"at_least": -60.0}}).required.startswith(
        f"≥ {MINUS}60"
    )
    assert (
        format_check({**check, "required": {"at_least": 0.0, "at_most": 0.0}}).required.split()[0]
        == "0"
    )
    assert format_check({**check, "required": None}).required == DASH


def test_amounts_come_in_the_units_that_people_use():
    assert format_amount(6.8229e6, "Hz").split() == ["6.823", "MHz"]
    assert format_amount(2.0454545e13, "Hz/s").split() == ["2.045", TIMES, "10¹³", "Hz/s"]
    assert format_amount(1.93e-12, "W").split() == ["1.93", "pW"]
    assert format_amount(0.0376811, "m") == "37.68 mm"
    assert format_amount(0.9, "1") == "0.9"
    assert format_amount(None, "m") == DASH
    assert format_count(100249600).split() == ["100", "249", "600"]


def test_two_figures_of_a_quantity_show_what_is_between_them():
    assert [text.split() for text in format_pair(49.98, 50.0047196, "m")] == [
        ["49.98", "m"],
        ["50.0047", "m"],
    ]
    assert format_pair(2200, 2200, "1") == ("2200", "2200")
    assert format_pair(None, 2.07, "m/s")[0] == DASH


def test_plain_text_is_set_as_print_has_it():
    assert apply_typography("at -24 dB and 1e-06, not 2.045e+13") == (
        f"at {MINUS}24 dB and 10⁻⁶, not 2.045 {TIMES} 10¹³"
    )
    assert apply_typography('10^-341 of "that" is the report\'s') == (
        "10⁻³⁴¹ of “that” is the report’s"  # noqa: RUF001
    )
    assert apply_typography("2-D, range-Doppler, 9-10") == "2-D, range-Doppler, 9-10"


def test_a_formula_stands_on_the_line_and_says_what_it_is():
    upright, deep = equation_svg("R"), equation_svg("f_0")
    assert 'aria-label="f_0"' in deep

    def below(formula: str) -> float:
        return float(re.search(r"vertical-align:(-?[\d.]+)em", formula)[1])

    assert abs(below(upright)) < 0.03
    assert below(deep) < -0.1
    assert "{" not in equation_svg(r"\frac{1}{2}")


def test_equations_are_numbered_as_they_come():
    text = typeset_equations(r"\[one| a = b \] then \[two| c \], \eqref{two} after \eqref{one}")
    assert re.findall(r"<i>\((\d)\)</i>", text) == ["1", "2"]
    assert text.index('href="#eq-two">(2)') < text.index('href="#eq-one">(1)')


@pytest.mark.parametrize("text", [r"\ref{figure:nowhere}", r"\cite{nobody}"])
def test_a_reference_to_nothing_is_an_error(text):
    with pytest.raises(KeyError):
        number_references(text, REFERENCES)


def test_a_reference_to_no_equation_is_an_error():
    with pytest.raises(KeyError):
        typeset_equations(r"\eqref{nothing}")
