"""Output of a study: report page, terminal tables and JSON document."""

import html as html_module
import io
import json
import re
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from dechirp.cli import study_output
from dechirp.core.text import EN_DASH, MINUS_SIGN, TIMES_SIGN
from dechirp.experiments.study.requirements import judge_requirements
from dechirp.experiments.study.scheduler import Progress
from dechirp.experiments.study.study import Requirement, SweptSetting
from dechirp.report.figures import study as figures
from dechirp.report.labels import format_with_interval, score_label, setting_label, value_label
from dechirp.report.study.figures import draw_score_figures
from dechirp.report.study.page import (
    StudyOrigin,
    format_headline,
    render_study_page,
    replay_command,
)
from dechirp.report.study.settings import format_confidence_percent
from dechirp.report.study.table import build_point_table
from dechirp.results.text_files import to_json_text
from nightly import NIGHTLY, nightly, nightly_except
from page_checks import check_captions, check_pdf_contains_page_text
from sample_studies import (
    DISTANCE,
    OFFSET,
    RCS,
    SCORES,
    WINDOW,
    HitProbability,
    make_layout,
    make_result,
)

ORIGIN = StudyOrigin(
    date="2026-11-22T15:00:00",
    source="my study.yaml",
    digests=(("my study.yaml", "5d" * 32),),
    environments=({"python": "3.11.7"},),
    seconds=30.0,
)
PD = "detection_probability"
TWO_DISTANCES = SweptSetting(
    path=DISTANCE.path, texts=("10 m", "20 m"), numbers=(10.0, 20.0), unit="m"
)


def render_page(study_result, sums=(), yaml="trials: {at_most: 200}\n"):
    verdicts = judge_requirements(study_result, lambda point: sums[point])
    return render_study_page(study_result, verdicts, yaml=yaml, origin=ORIGIN)


def extract_text(page):
    """Return the visible text of a page, without the figures."""
    plain = re.sub(r"<(svg|style|script)\b.*?</\1>", " ", page, flags=re.DOTALL)
    plain = re.sub(r"<[^>]+>", " ", plain)
    return re.sub(r"\s+", " ", html_module.unescape(plain))


@pytest.mark.parametrize(
    ("axes", "settings", "n_figures"),
    nightly_except(
        2,
        [
            ((WINDOW,), {"targets": ("car", "truck")}, 1),
            ((), {}, 0),
            ((RCS, WINDOW), {"scores": SCORES}, 3),
            # Lines and a map for each target.
            ((RCS, DISTANCE), {"targets": ("car", "truck")}, 4),
            ((WINDOW, OFFSET), {"n_draws": 8}, 1),
            # One figure for each window.
            ((RCS, TWO_DISTANCES, WINDOW), {}, 2),
        ],
    ),
    ids=["bars", "point", "lines", "maps", "random", "three axes"],
)
def test_every_kind_of_study_has_expected_number_of_figures(axes, settings, n_figures):
    study_result, _ = make_result(*axes, n_trials=20, **{"scores": (HitProbability(),), **settings})

    html = render_page(study_result)

    assert html.count("<svg") == n_figures
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", html)
    assert "url(http" not in html
    assert "@import" not in html
    assert "mathdefault" not in html
    assert "nan" not in re.findall(r"[a-z]+", extract_text(html).lower())
    if NIGHTLY:
        check_pdf_contains_page_text(html)
    if n_figures:
        check_captions(html)


def test_same_result_gives_same_page():
    study_result, _ = make_result(RCS, n_trials=20, scores=(HitProbability(),))

    assert render_page(study_result) == render_page(study_result)


def test_page_starts_with_requirements_and_their_evidence():
    close_m = 1.001 * make_result(RCS)[0].points_as_dicts[3]["range_rmse"]["value"]
    study_result, sums = make_result(
        RCS,
        require=(
            Requirement(score=PD, target="car", points=((RCS.path, "20 dBsm"),), at_least=0.9),
            Requirement(score=PD, points=((RCS.path, "5 dBsm"),), at_least=0.9),
            Requirement(score="range_rmse", points=((RCS.path, "5 dBsm"),), at_most=close_m),
        ),
    )

    text = extract_text(render_page(study_result, sums))

    assert "Of 3 requirements 1 met, 1 not met, 1 undecided" in text
    assert text.index("Requirements") < text.index("Varied settings")
    assert "detection probability of car ≥ 0.9 RCS of car 20 dBsm met" in text
    assert re.search(r"range RMSE ≤ [\d.]+ mm RCS of car 5 dBsm undecided", text)
    assert "created 22 November 2026, 15:00 UTC" in text
    assert f"SHA-256 of my study.yaml {'5d' * 32}" in text
    assert "seed 7 trials 1 400, 0 failed" in text
    assert "name date signature" in text
    assert "Bands and bars are intervals that contain the true value" in text
    assert "Each value is followed by its interval, which contains the true value" in text


@pytest.mark.parametrize(
    ("decisions", "text"),
    [
        (["met", "met"], "All requirements met"),
        (["met"], "Requirement met"),
        (["undecided"], "Requirement undecided"),
        (["met", "not met"], "Of 2 requirements 1 met, 1 not met"),
    ],
)
def test_headline_states_decisions(decisions, text):
    study_result, _ = make_result(n_trials=5)

    assert (
        format_headline(
            study_result, [SimpleNamespace(decision=decision) for decision in decisions]
        )
        == text
    )


def test_failures_are_grouped_by_message_with_replay_command():
    message = "ValueError: <b>no</b> & never"
    failed = [(3, 17, message), (3, 18, message), (5, 2, "KeyError: 'x'")]
    study_result, _ = make_result(RCS, WINDOW, failed=failed, scores=(HitProbability(),))

    text = extract_text(render_page(study_result))

    assert "2 trials: ValueError: <b>no</b> & never" in text
    assert "First trial 17, RCS of car \N{MINUS SIGN}5 dBsm, range window rectangular" in text
    assert "<b>no</b>" not in render_page(study_result)
    command = replay_command(ORIGIN.source, 17, study_result.settings[3])
    assert command in text
    assert shlex.split(command)[1:] == [
        *("study", "my study.yaml", "--trial", "17"),
        *("--set", "scene.targets.car.rcs=-5 dBsm", "--set", "chain.range_window=rectangular"),
    ]


def test_point_table_has_columns_per_target_and_counts_omitted_points():
    study_result, _ = make_result(RCS, targets=("car", "truck"))

    table = build_point_table(study_result, max_rows=3)

    headings = [column.label for column in table.columns]
    assert "detection probability of truck" in headings
    assert "range RMSE of car (mm)" in headings
    assert (len(table.rows), table.n_more) == (3, 4)
    column_index = headings.index("range RMSE of car (mm)")
    value_m = study_result.points_as_dicts[0]["range_rmse"]["targets"]["car"]["value"]
    assert float(table.rows[0][column_index]) == pytest.approx(1e3 * value_m, rel=0.01)


@nightly
def test_page_names_file_with_omitted_points(monkeypatch):
    monkeypatch.setattr(
        "dechirp.report.study.page.build_point_table",
        lambda result: build_point_table(result, max_rows=3),
    )
    study_result, _ = make_result(RCS)

    html = render_study_page(study_result, [], yaml="", origin=ORIGIN, points_file="points.csv")

    assert "4 more are in <code>points.csv</code>" in html


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("scene.targets.car.rcs", "RCS of car"),
        ("scene.targets.my_car.position.0", "position x of my_car"),
        ("chain.cfar.false_alarm_probability", "false-alarm probability of CFAR"),
        ("chain.range_window", "range window"),
        ("impairments.white-noise.snr", "SNR of white noise"),
        ("radar.frame.chirp.slope", "slope of chirp"),
        ("n_frames", "n frames"),
    ],
)
def test_setting_label_is_readable(path, text):
    assert setting_label(path) == text


def test_score_and_value_labels_are_readable():
    assert score_label("range_rmse") == "range RMSE"
    assert value_label("{kind: ordered-statistic}") == "ordered statistic"
    assert value_label("-10 dBsm") == "\N{MINUS SIGN}10 dBsm"


@pytest.mark.parametrize(
    ("numbers", "texts"),
    [
        ((0.913, 0.894, 0.929), ("0.913", "0.894 to 0.929")),
        ((1.21e-6, 1.1e-6, 1.3e-6), (f"1.21 {TIMES_SIGN} 10⁻⁶", f"1.10 to 1.30 {TIMES_SIGN} 10⁻⁶")),
        ((0.0, 0.0, 3e-5), (f"0.0 {TIMES_SIGN} 10⁻⁵", f"0.0 to 3.0 {TIMES_SIGN} 10⁻⁵")),
        ((152.3, 140.0, 166.0), ("152", "140 to 166")),
        ((np.nan, np.nan, np.nan), (EN_DASH, EN_DASH)),
        ((-0.001, -0.02, 0.02), (f"{MINUS_SIGN}0.001", f"{MINUS_SIGN}0.020 to 0.020")),
    ],
)
def test_value_is_rounded_to_two_digits_of_its_interval(numbers, texts):
    assert format_with_interval(*numbers) == texts


@pytest.mark.parametrize(
    ("certainty", "text"),
    [
        (0.95, "95\xa0%"),
        (0.9996, "99.96\xa0%"),
        (0.99999, "99.999\xa0%"),
        (1 - 1e-9, "over 99.9999\xa0%"),
        (0.9499, "94\xa0%"),
        (np.nan, EN_DASH),
    ],
)
def test_certainty_is_never_rounded_up(certainty, text):
    assert format_confidence_percent(certainty) == text


def test_axis_scale_follows_kind_and_range_of_values():
    assert figures.choose_axis_scale(np.array([0.0, 0.5, 1.0]), is_ratio=True) == "shares"
    assert figures.choose_axis_scale(np.array([0.0, 1e-6, 1e-3]), is_ratio=True) == "log"
    assert figures.choose_axis_scale(np.array([0.9e-3, 1.1e-3]), is_ratio=True) == "linear"
    assert figures.choose_axis_scale(np.array([0.01, 1.0]), is_ratio=False) == "log"
    assert figures.choose_axis_scale(np.array([-0.01, 1.0]), is_ratio=False) == "linear"
    assert figures.choose_axis_scale(np.array([np.nan]), is_ratio=False) == "linear"
    assert figures.is_suited_to_log_axis((1, 10, 100))
    assert not figures.is_suited_to_log_axis((10, 20, 30, 40))


@nightly
def test_figure_thins_many_values_and_states_their_number():
    many = SweptSetting(
        path="scene.targets.car.position.1",
        texts=tuple(f"{n} m" for n in range(30)),
        numbers=tuple(map(float, range(30))),
        unit="m",
    )
    study_result, _ = make_result(many, WINDOW, n_trials=5, scores=(HitProbability(),))
    second_result, _ = make_result(
        many,
        SweptSetting(path=RCS.path, texts=tuple(f"{n} dBsm" for n in range(20))),
        n_trials=5,
        scores=(HitProbability(),),
    )

    (first_figure, *_), *_ = (group.figures for group in draw_score_figures(study_result))
    (second_figure, *_), *_ = (group.figures for group in draw_score_figures(second_result))

    assert first_figure.caption.startswith("over position y of car, by range window. ")
    assert second_figure.caption.startswith(
        "over position y of car, by RCS of car, 8 of 20 values. "
    )


def test_terminal_table_fits_width():
    study_result, _ = make_result(RCS, targets=("car", "truck"), n_trials=50)

    def render_table(width):
        console = Console(width=width, record=True, file=io.StringIO())
        console.print(study_output.study_points_table(study_result, width=width))
        return console.export_text()

    assert max(map(len, render_table(80).splitlines())) <= 80
    assert "truck" in render_table(80)
    assert "RMSE" not in render_table(70)
    assert "false-alarm" in re.sub(r"\s+", " ", render_table(160))
    # No cell is truncated.
    assert "…" not in render_table(80)


def test_progress_line_shows_points_trials_speed_and_time_left():
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(study_output.study_progress_bar(Progress(3, 8, 240, 480, 120.5, 5400.0, 1)))

    assert "3 of 8 points, 240 of 480 trials, 120 trials/s, 1.5 h left, 1 failed" in (
        console.export_text()
    )


def test_no_progress_is_shown_without_terminal(capsys):
    with study_output.show_live_progress(
        SimpleNamespace(), make_layout(), SimpleNamespace(), quiet=False
    ) as report:
        assert report is None  # standard error is not a terminal in tests
    assert capsys.readouterr() == ("", "")


def test_json_document_contains_rows_requirements_and_failures():
    study_result, sums = make_result(
        RCS,
        failed=[(1, 7, "ValueError: no")],
        require=(Requirement(score=PD, points=((RCS.path, "20 dBsm"),), at_least=0.9),),
    )
    verdicts = judge_requirements(study_result, lambda point: sums[point])

    document = study_output.study_json_document(
        study_result, verdicts, version="1", n_done=1400, n_total=1400, files={}
    )

    content = json.loads(to_json_text(document))
    assert set(content) >= {"version", "seed", "rows", "done", "total", "require", "files"}
    assert content["rows"] == study_result.points_as_dicts
    (requirement,) = content["require"]
    assert (requirement["decision"], requirement["at_least"]) == ("met", 0.9)
    assert requirement["point_settings"] == requirement["deciding"] == {RCS.path: "20 dBsm"}
    assert content["failures"] == [{"point": 1, "trial": 7, "message": "ValueError: no"}]
    assert content["findings"][0]["point"] == 1


def test_each_requirement_is_one_sentence():
    study_result, sums = make_result(RCS, require=(Requirement(score=PD, at_least=0.9),))

    (paragraph,) = study_output.requirement_paragraphs(
        judge_requirements(study_result, lambda point: sums[point]), study_result
    )

    assert paragraph.plain.startswith(
        "not met: detection probability ≥ 0.9 (at every point, met at "
    )
    assert paragraph.plain.endswith("certainty over 99.9999\xa0%.")
