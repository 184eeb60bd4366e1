"""The page, the terminal and the document of a study: each says what the result says."""

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
from dechirp.report.study.settings import format_percent
from dechirp.report.study.table import build_point_table
from dechirp.results.tables import json_text
from printed import check_captions, check_pdf
from study_made import DISTANCE, OFFSET, RCS, SCORES, WINDOW, Share, layout, result

MADE = StudyOrigin(
    date="2026-11-22T15:00:00",
    source="my study.yaml",
    digests=(("my study.yaml", "5d" * 32),),
    environments=({"python": "3.11.7"},),
    seconds=30.0,
)
PD = "detection_probability"
TWO = SweptSetting(path=DISTANCE.path, texts=("10 m", "20 m"), numbers=(10.0, 20.0), unit="m")


def page(found, kept=(), yaml="trials: {at_most: 200}\n"):
    judged = judge_requirements(found, lambda point: kept[point])
    return render_study_page(found, judged, yaml=yaml, origin=MADE)


def words(html):
    """What a reader sees, without the figures."""
    plain = re.sub(r"<(svg|style|script)\b.*?</\1>", " ", html, flags=re.DOTALL)
    plain = re.sub(r"<[^>]+>", " ", plain)
    return re.sub(r"\s+", " ", html_module.unescape(plain))


@pytest.mark.parametrize(
    ("axes", "settings", "n_figures"),
    [
        ((), {}, 0),
        ((RCS, WINDOW), {"scores": SCORES}, 3),
        ((WINDOW,), {"targets": ("car", "truck")}, 1),
        # Lines and a map of each target.
        ((RCS, DISTANCE), {"targets": ("car", "truck")}, 4),
        ((WINDOW, OFFSET), {"n_draws": 8}, 1),
        # One figure for each window.
        ((RCS, TWO, WINDOW), {}, 2),
    ],
    ids=["point", "lines", "bars", "maps", "drawn", "three"],
)
def test_every_kind_of_study_has_its_figures_and_one_page(axes, settings, n_figures):
    found, _ = result(*axes, n_trials=20, **{"scores": (Share(),), **settings})

    html = page(found)

    assert html.count("<svg") == n_figures
    assert not re.search(r"""(src|href)\s*=\s*["']?\s*(https?:)?//""", html)
    assert "url(http" not in html
    assert "@import" not in html
    assert "mathdefault" not in html
    assert "nan" not in re.findall(r"[a-z]+", words(html).lower())
    check_pdf(html)
    if n_figures:
        check_captions(html)


def test_the_same_result_gives_the_same_page():
    found, _ = result(RCS, n_trials=20, scores=(Share(),))

    assert page(found) == page(found)


def test_a_safety_engineer_reads_first_what_is_met_and_on_what_that_rests():
    close_m = 1.001 * result(RCS)[0].rows[3]["range_rmse"]["value"]
    found, kept = result(
        RCS,
        require=(
            Requirement(score=PD, target="car", points=((RCS.path, "20 dBsm"),), at_least=0.9),
            Requirement(score=PD, points=((RCS.path, "5 dBsm"),), at_least=0.9),
            Requirement(score="range_rmse", points=((RCS.path, "5 dBsm"),), at_most=close_m),
        ),
    )

    said = words(page(found, kept))

    assert "Of 3 requirements 1 met, 1 not met, 1 undecided" in said
    assert said.index("Requirements") < said.index("Varied settings")
    assert "detection probability of car ≥ 0.9 RCS of car 20 dBsm met" in said
    assert re.search(r"range RMSE ≤ [\d.]+ mm RCS of car 5 dBsm undecided", said)
    assert "created 22 November 2026, 15:00 UTC" in said
    assert f"SHA-256 of my study.yaml {'5d' * 32}" in said
    assert "seed 7 trials 1 400, 0 failed" in said
    assert "name date signature" in said
    assert "Bands and bars are intervals that contain the true value" in said
    assert "Each value is followed by its interval, which contains the true value" in said


@pytest.mark.parametrize(
    ("decisions", "said"),
    [
        (["met", "met"], "All requirements met"),
        (["met"], "Requirement met"),
        (["undecided"], "Requirement undecided"),
        (["met", "not met"], "Of 2 requirements 1 met, 1 not met"),
    ],
)
def test_the_headline_is_the_decision(decisions, said):
    found, _ = result(n_trials=5)

    assert format_headline(found, [SimpleNamespace(decision=one) for one in decisions]) == said


def test_failures_are_told_by_message_with_how_to_see_one_again():
    message = "ValueError: <b>no</b> & never"
    failed = [(3, 17, message), (3, 18, message), (5, 2, "KeyError: 'x'")]
    found, _ = result(RCS, WINDOW, failed=failed, scores=(Share(),))

    said = words(page(found))

    assert "2 trials: ValueError: <b>no</b> & never" in said
    assert "First trial 17, RCS of car \N{MINUS SIGN}5 dBsm, range window rectangular" in said
    assert "<b>no</b>" not in page(found)
    command = replay_command(MADE.source, 17, found.settings[3])
    assert command in said
    assert shlex.split(command)[1:] == [
        *("study", "my study.yaml", "--trial", "17"),
        *("--set", "scene.targets.car.rcs=-5 dBsm", "--set", "chain.range_window=rectangular"),
    ]


def test_the_table_has_each_target_and_says_how_many_points_are_left_out():
    found, _ = result(RCS, targets=("car", "truck"))

    shown = build_point_table(found, max_rows=3)

    heads = [column.label for column in shown.columns]
    assert "detection probability of truck" in heads
    assert "range RMSE of car (mm)" in heads
    assert (len(shown.rows), shown.n_more) == (3, 4)
    at = heads.index("range RMSE of car (mm)")
    told_m = found.rows[0]["range_rmse"]["targets"]["car"]["value"]
    assert float(shown.rows[0][at]) == pytest.approx(1e3 * told_m, rel=0.01)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("scene.targets.car.rcs", "RCS of car"),
        ("scene.targets.my_car.position.0", "position x of my_car"),
        ("chain.cfar.false_alarm_probability", "false alarm probability of CFAR"),
        ("chain.range_window", "range window"),
        ("impairments.white-noise.snr", "SNR of white noise"),
        ("radar.frame.chirp.slope", "slope of chirp"),
        ("n_frames", "n frames"),
    ],
)
def test_axes_say_a_setting_in_words(path, said):
    assert setting_label(path) == said


def test_words_of_scores_and_values():
    assert score_label("range_rmse") == "range RMSE"
    assert value_label("{kind: ordered-statistic}") == "ordered statistic"
    assert value_label("-10 dBsm") == "\N{MINUS SIGN}10 dBsm"


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((0.913, 0.894, 0.929), ("0.913", "0.894 to 0.929")),
        ((1.21e-6, 1.1e-6, 1.3e-6), (f"1.21 {TIMES_SIGN} 10⁻⁶", f"1.10 to 1.30 {TIMES_SIGN} 10⁻⁶")),
        ((0.0, 0.0, 3e-5), (f"0.0 {TIMES_SIGN} 10⁻⁵", f"0.0 to 3.0 {TIMES_SIGN} 10⁻⁵")),
        ((152.3, 140.0, 166.0), ("152", "140 to 166")),
        ((np.nan, np.nan, np.nan), (EN_DASH, EN_DASH)),
        ((-0.001, -0.02, 0.02), (f"{MINUS_SIGN}0.001", f"{MINUS_SIGN}0.020 to 0.020")),
    ],
)
def test_a_value_is_written_with_two_digits_of_its_interval(numbers, said):
    assert format_with_interval(*numbers) == said


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (0.95, "95\xa0%"),
        (0.9996, "99.96\xa0%"),
        (0.99999, "99.999\xa0%"),
        (1 - 1e-9, "over 99.9999\xa0%"),
        (0.9499, "94\xa0%"),
        (np.nan, EN_DASH),
    ],
)
def test_nothing_is_said_to_be_more_certain_than_it_is(share, said):
    assert format_percent(share) == said


def test_shares_go_from_0_to_1_and_errors_over_decades():
    assert figures.choose_axis_scale(np.array([0.0, 0.5, 1.0]), is_ratio=True) == "shares"
    assert figures.choose_axis_scale(np.array([0.0, 1e-6, 1e-3]), is_ratio=True) == "log"
    assert figures.choose_axis_scale(np.array([0.9e-3, 1.1e-3]), is_ratio=True) == "linear"
    assert figures.choose_axis_scale(np.array([0.01, 1.0]), is_ratio=False) == "log"
    assert figures.choose_axis_scale(np.array([-0.01, 1.0]), is_ratio=False) == "linear"
    assert figures.choose_axis_scale(np.array([np.nan]), is_ratio=False) == "linear"
    assert figures.is_evenly_spaced_in_ratio((1, 10, 100))
    assert not figures.is_evenly_spaced_in_ratio((10, 20, 30, 40))


def test_more_values_than_a_figure_tells_apart_are_thinned_and_said_so():
    many = SweptSetting(
        path="scene.targets.car.position.1",
        texts=tuple(f"{n} m" for n in range(30)),
        numbers=tuple(map(float, range(30))),
        unit="m",
    )
    found, _ = result(many, WINDOW, n_trials=5, scores=(Share(),))
    turned, _ = result(
        many,
        SweptSetting(path=RCS.path, texts=tuple(f"{n} dBsm" for n in range(20))),
        n_trials=5,
        scores=(Share(),),
    )

    (first, *_), *_ = (one.figures for one in draw_score_figures(found))
    (words_, *_), *_ = (one.figures for one in draw_score_figures(turned))

    assert first.caption.startswith("over position y of car, by range window. ")
    assert words_.caption.startswith("over position y of car, by RCS of car, 8 of 20 values. ")


def test_the_terminal_shows_as_many_scores_as_there_is_room_for():
    found, _ = result(RCS, targets=("car", "truck"), n_trials=50)

    def shown(width):
        console = Console(width=width, record=True, file=io.StringIO())
        console.print(study_output.points_table(found, width=width))
        return console.export_text()

    assert max(map(len, shown(80).splitlines())) <= 80
    assert "truck" in shown(80)
    assert "RMSE" not in shown(70)
    assert "false alarm" in re.sub(r"\s+", " ", shown(160))
    # Whole cells: nothing is cut.
    assert "…" not in shown(80)


def test_progress_says_points_trials_speed_and_time_left():
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(study_output.progress_line(Progress(3, 8, 240, 480, 120.5, 5400.0, 1)))

    assert "3 of 8 points, 240 of 480 trials, 120 trials/s, 1.5 h left, 1 failed" in (
        console.export_text()
    )


def test_nobody_who_does_not_look_is_shown_anything(capsys):
    with study_output.live_progress(
        SimpleNamespace(), layout(), SimpleNamespace(), quiet=False
    ) as report:
        assert report is None  # standard error is no terminal here
    assert capsys.readouterr() == ("", "")


def test_the_document_holds_rows_requirements_and_failures_in_plain_values():
    found, kept = result(
        RCS,
        failed=[(1, 7, "ValueError: no")],
        require=(Requirement(score=PD, points=((RCS.path, "20 dBsm"),), at_least=0.9),),
    )
    judged = judge_requirements(found, lambda point: kept[point])

    made = study_output.study_document(
        found, judged, version="1", n_done=1400, n_total=1400, files={}
    )

    read = json.loads(json_text(made))
    assert set(read) >= {"version", "seed", "rows", "done", "total", "require", "files"}
    assert read["rows"] == found.rows
    (asked,) = read["require"]
    assert (asked["decision"], asked["at_least"]) == ("met", 0.9)
    assert asked["point_settings"] == asked["deciding"] == {RCS.path: "20 dBsm"}
    assert read["failures"] == [{"point": 1, "trial": 7, "message": "ValueError: no"}]
    assert read["findings"][0]["point"] == 1


def test_requirements_are_a_sentence_each():
    found, kept = result(RCS, require=(Requirement(score=PD, at_least=0.9),))

    (said,) = study_output.requirement_paragraphs(
        judge_requirements(found, lambda point: kept[point]), found
    )

    assert said.plain.startswith("not met: detection probability ≥ 0.9 (at every point, met at ")
    assert said.plain.endswith("certainty over 99.9999\xa0%.")
