"""The paper of a full certificate: what is certified beyond the report, in tables and a figure."""

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
from dechirp.certificate.document import _claim_entry, _part_entry
from dechirp.report.figures import false_alarm_rates

WINDOWS = ("rectangular windows", "Hann windows", "at both ends of the range, all windows")


def check(name, measured, *, unit="1", within=0.2, limit=1.0, interval=0.04):
    return Check(
        name=name,
        unit=unit,
        measured=measured,
        low=measured - interval,
        high=measured + interval,
        at_least=limit - within,
        at_most=limit + within,
        limit=limit,
        trials=10_000,
    )


def claim(name, *checks):
    return Claim(id=name, claim=f"A claim about {name}.", checks=checks)


def parts(greatest_of=1.01):
    return (
        Part(
            id="false_alarms",
            title="False alarms of every detector",
            method="In noise.",
            claims=(
                claim("false_alarms_cell_averaging", *(check(w, 1.02) for w in WINDOWS)),
                claim("false_alarms_greatest_of", *(check(w, greatest_of) for w in WINDOWS)),
            ),
        ),
        Part(
            id="directions",
            title="Errors of every direction estimator",
            method="On a line.",
            claims=(
                claim(
                    "directions_root_music",
                    check("error", 1.16, limit=1.17),
                    *[check("pair", 0.99)] * 2,
                ),
                claim("directions_monopulse", check("error", 1.34, limit=1.31)),
            ),
        ),
        Part(
            id="impairments",
            title="Every impairment against its formula",
            method="On samples.",
            claims=(
                claim(
                    "impairment_dc_offset",
                    check("power", -60.0, unit="dBm", limit=-60.0),
                    replace(check("phase", 0.7, unit="rad", limit=0.7), low=None, high=None),
                ),
            ),
        ),
    )


@pytest.fixture
def page(document, monkeypatch):  # noqa: F811
    """Text of the paper with parts, without its figures."""
    monkeypatch.setattr(paper, "draw_figures", lambda _: defaultdict(lambda: Markup("<svg></svg>")))

    def rendered(made):
        told = {**document, "parts": [_part_entry(part) for part in made]}
        return paper.render_paper(told)

    return rendered


def test_all_parts_are_on_the_page_with_their_numbers(page):
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page(parts())))
    assert (
        "16 of its claims" in text and "A further 5 claims beyond the report are certified" in text
    )
    assert "All 21 claims hold" in text
    assert "FAILS" not in text
    for words in ("greatest-of", "root-music", "dc-offset", "It estimates one direction only."):
        assert words in text
    for words in WINDOWS:
        assert words in text
    assert "1.160 1.120 to 1.200 1.170" in text  # error, its interval, what is stated
    assert "\N{MINUS SIGN}60.000 dBm" in text


def test_without_parts_the_page_says_nothing_of_them(page):
    text = page(())
    assert "Beyond the report" not in text
    assert "further claims" not in text
    assert "All 16 claims hold" in text


def test_a_claim_beyond_the_report_that_fails_is_named_at_the_top(page):
    text = page(parts(greatest_of=1.3))
    top = text[: text.index("<h2>")]
    assert "NOT CERTIFIED: 1 of 21 claims fails" in top
    assert "false_alarms_greatest_of" in top
    assert text.count('<td class="num fails">') == len(WINDOWS)


def test_the_figure_has_a_mark_with_its_interval_for_every_rate():
    detectors = [
        false_alarm_rates.DetectorRates(name=one.id, checks=_claim_entry(one)["checks"])
        for one in parts()[0].claims
    ]
    axes = false_alarm_rates.draw_alarm_ratios(Figure().subplots(), detectors)

    assert [label.get_text() for label in axes.get_yticklabels()] == list(WINDOWS)
    for drawn, detector in zip(axes.containers, detectors, strict=True):
        line, _, (bars,) = drawn
        assert line.get_xdata() == pytest.approx([one["measured"] for one in detector.checks])
        ends = np.array([segment[:, 0] for segment in bars.get_segments()])
        assert ends == pytest.approx(np.array([one["interval"] for one in detector.checks]))
    dashed = {line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == "--"}
    assert dashed == {0.8, 1.2}
