"""Paper of a full certificate: detector, direction and impairment claims beyond the report."""

import re
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from markupsafe import Markup
from matplotlib.figure import Figure
from test_paper import document  # noqa: F401

from dechirp.certificate import paper
from dechirp.certificate.claim import Check, Claim, Part
from dechirp.certificate.document import _claim_as_json_data, _part_as_json_data
from dechirp.report.figures import false_alarm_rates

WINDOWS = ("rectangular windows", "Hann windows", "at both ends of the range, all windows")


def make_check(name, measured, *, unit="1", tolerance=0.2, limit=1.0, interval=0.04):
    return Check(
        name=name,
        unit=unit,
        measured=measured,
        low=measured - interval,
        high=measured + interval,
        at_least=limit - tolerance,
        at_most=limit + tolerance,
        limit=limit,
        trials=10_000,
    )


def make_claim(name, *checks):
    return Claim(id=name, claim=f"A claim about {name}.", checks=checks)


def make_parts(greatest_of=1.01):
    return (
        Part(
            id="false_alarms",
            title="False alarms of every detector",
            method="In noise.",
            claims=(
                make_claim("false_alarms_cell_averaging", *(make_check(w, 1.02) for w in WINDOWS)),
                make_claim(
                    "false_alarms_greatest_of", *(make_check(w, greatest_of) for w in WINDOWS)
                ),
            ),
        ),
        Part(
            id="directions",
            title="Errors of every direction estimator",
            method="On a line.",
            claims=(
                make_claim(
                    "directions_root_music",
                    make_check("error", 1.16, limit=1.17),
                    *[make_check("pair", 0.99)] * 2,
                ),
                make_claim("directions_monopulse", make_check("error", 1.34, limit=1.31)),
            ),
        ),
        Part(
            id="impairments",
            title="Every impairment against its formula",
            method="On samples.",
            claims=(
                make_claim(
                    "impairment_dc_offset",
                    make_check("power", -60.0, unit="dBm", limit=-60.0),
                    replace(make_check("phase", 0.7, unit="rad", limit=0.7), low=None, high=None),
                ),
            ),
        ),
    )


@pytest.fixture
def render_page(document, monkeypatch):  # noqa: F811
    """Return a function that renders the paper with parts, without its figures."""
    monkeypatch.setattr(
        paper, "draw_paper_figures", lambda _: defaultdict(lambda: Markup("<svg></svg>"))
    )

    def render_with_parts(certificate_parts):
        full_document = {
            **document,
            "parts": [_part_as_json_data(part) for part in certificate_parts],
        }
        return paper.render_paper(full_document)

    return render_with_parts


def test_page_contains_all_parts_with_numbers(render_page):
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", render_page(make_parts())))
    assert (
        "16 of its claims" in text and "A further 5 claims beyond the report are certified" in text
    )
    assert "All 21 claims hold" in text
    assert "FAILS" not in text
    for phrase in ("greatest-of", "root-music", "dc-offset", "It estimates one direction only."):
        assert phrase in text
    for phrase in WINDOWS:
        assert phrase in text
    assert "1.160 1.120 to 1.200 1.170" in text  # error, its interval, stated value
    assert "\N{MINUS SIGN}60.000 dBm" in text


def test_page_without_parts_has_no_section_beyond_report(render_page):
    text = render_page(())
    assert "Beyond the report" not in text
    assert "further claims" not in text
    assert "All 16 claims hold" in text


def test_failed_claim_beyond_report_is_named_at_top(render_page):
    text = render_page(make_parts(greatest_of=1.3))
    top = text[: text.index("<h2>")]
    assert "NOT CERTIFIED: 1 of 21 claims fails" in top
    assert "false_alarms_greatest_of" in top
    assert text.count('<td class="num fails">') == len(WINDOWS)


def test_alarm_rate_figure_has_marker_and_interval_for_every_rate():
    detectors = [
        false_alarm_rates.DetectorRates(name=entry.id, checks=_claim_as_json_data(entry)["checks"])
        for entry in make_parts()[0].claims
    ]
    axes = false_alarm_rates.draw_false_alarm_ratios(Figure().subplots(), detectors)

    assert [label.get_text() for label in axes.get_yticklabels()] == list(WINDOWS)
    for container, detector in zip(axes.containers, detectors, strict=True):
        line, _, (bars,) = container
        assert line.get_xdata() == pytest.approx([entry["measured"] for entry in detector.checks])
        ends = np.array([segment[:, 0] for segment in bars.get_segments()])
        assert ends == pytest.approx(np.array([entry["interval"] for entry in detector.checks]))
    dashed = {line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == "--"}
    assert dashed == {0.8, 1.2}
