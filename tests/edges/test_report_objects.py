"""What the report and the terminal say of clusters, own motion and tracks."""

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.console import open_console
from dechirp.cli.run_output import object_output
from dechirp.report import objects_section
from dechirp.report.figures import tracks as figure
from dechirp.report.page import render_report
from radars import of_eight_receivers

RADAR = of_eight_receivers(period_s=0.05)
TARGETS = (
    dc.Target(name="left", position_m=(30, 6, 0), velocity_m_per_s=(-8, 0, 0)),
    dc.Target(name="right", position_m=(20, -5, 0), velocity_m_per_s=(6, 1, 0)),
)


def ran(**changes) -> dc.Result:
    settings = {
        "radar": RADAR,
        "scene": dc.Scene(targets=TARGETS),
        "n_frames": 6,
        "chain": dc.Chain(cluster=dc.Dbscan()),
        "tracker": dc.Tracker(target_size_m=0.1),
    }
    return dc.run(dc.Scenario(**settings | changes))


@pytest.fixture(scope="module")
def result() -> dc.Result:
    return ran()


def rows_of(page: str) -> list[list[str]]:
    section = page[page.index('<section id="objects">') :]
    body = section[section.index("<tbody>") : section.index("</tbody>")]
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall("<tr>.*?</tr>", body)]


def test_the_table_has_each_track_where_it_ends_with_its_target(result):
    rows = rows_of(render_report(result, yaml=""))

    at_last = result.scenario.scene.target_positions_m(result.truth.time.values[-1:])[0]
    assert sorted(row[-1] for row in rows) == ["left", "right"]
    for number, frames, *amounts, name in rows:
        assert frames == "2 to 5"
        (x, x_std), (y, y_std), (vx, _), _ = (
            [
                float(part.replace("\N{MINUS SIGN}", "-"))
                for part in cell.split(" ±\N{NO-BREAK SPACE}")
            ]
            for cell in amounts
        )
        which = ("left", "right").index(name)
        place, velocity = at_last[which], TARGETS[which].velocity_m_per_s
        # Six standard errors, and what is rounded off.
        assert abs(x - place[0]) < 6 * x_std + 0.05 and abs(y - place[1]) < 6 * y_std + 0.05
        assert abs(vx - velocity[0]) < 1.5
        assert result.tracks.x.sel(track=int(number)).values[-1] == pytest.approx(x, abs=0.051)


def test_a_page_says_how_many_there_are_and_of_what(result):
    page = render_report(result, yaml="")
    assert "Tracks cover 2 of 2 targets, one each." in page
    assert f"{result.clusters.sizes['cluster']} clusters of" in page
    assert "2 tracks confirmed in 6 frames." in page
    assert "unscented filter, joint association" in page
    assert 'id="objects"' not in render_report(ran(tracker=None, chain=dc.Chain()), yaml="")


def test_the_figure_has_the_number_of_every_track_and_the_truth_of_every_target(result):
    page = render_report(result, yaml="")
    drawn = page[page.index('aria-label="Tracks from above"') :]
    drawn = drawn[: drawn.index("</svg>")]
    written = re.findall(r"<text[^>]*>([^<]*)</text>", drawn)
    assert {"0", "1", "truth", "track", "detection", "y (m, left positive)"} <= set(written)


def test_of_very_many_tracks_the_longest_are_drawn(result):
    short = result.tracks.isel(track=[0] * 100)
    short["status"] = short.status.where(short.frame < 4, "")
    many = xr.concat([short, result.tracks], "track").assign_coords(track=np.arange(102))
    page = render_report(replace(result, tracks=many), yaml="")
    drawn = page[page.index('aria-label="Tracks from above"') :].split("</svg>")[0]

    assert "Shown are the 60 longest of 102 tracks." in page
    written = set(re.findall(r">(\d+)</text>", drawn))
    # The two that stay to the end, and the first ones of those that do not.
    assert {"0", "57", "100", "101"} <= written and not {"58", "99"} & written
    assert "The table contains the first 50 tracks; all are in" in page


def test_an_ellipse_is_the_covariance():
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    line = figure.TrackLine(
        number=0,
        positions_m=np.zeros((1, 2)),
        is_confirmed=np.array([True]),
        velocity_m_per_s=np.zeros(2),
        covariance_m2=covariance,
    )
    around = line.error_ellipse_m()
    # Each point is one standard error away, and they reach as far along x and y as these have.
    distance2 = np.einsum("in,ij,jn->n", around, np.linalg.inv(covariance), around)
    assert distance2 == pytest.approx(1.0)
    assert abs(around).max(axis=1) == pytest.approx([2.0, 1.0], rel=2e-3)


def test_a_track_that_goes_over_to_another_target_is_told_as_such(result):
    tracks = result.tracks.copy(deep=True)
    right = [names[0] for names in objects_section.targets_of_tracks(result, tracks)].index("right")
    positions_m = result.scenario.scene.target_positions_m(result.truth.time.values)[:, 0]
    for name, column in zip("xy", positions_m.T, strict=False):
        tracks[name].values[right, 4:] = column[4:]

    assert objects_section.targets_of_tracks(result, tracks)[right] == ["right", "left"]


def test_a_track_far_from_all_targets_is_of_none(result):
    moved = result.tracks.assign(x=result.tracks.x + 8.0)
    assert objects_section.targets_of_tracks(result, moved) == [[], []]


def test_tracks_without_a_truth_have_no_targets(result):
    recorded = replace(result, truth=None)
    assert objects_section.summarise_track_targets(recorded) == ""
    assert [row["target"] for row in objects_section.track_rows(recorded, 5)] == ["\N{EN DASH}"] * 2


def test_no_track_is_no_table(result):
    quiet = ran(scene=dc.Scene(targets=()))
    assert quiet.tracks.sizes["track"] == 0
    page = render_report(quiet, yaml="")
    assert "0 tracks confirmed" in page and 'aria-label="Tracks from above"' not in page


@pytest.mark.parametrize("width", [80, 60])
def test_the_terminal_shows_tracks_in_the_room_there_is(result, width, capsys):
    screen = open_console()
    screen.width = width
    for part in object_output(result, at_most=1, width=width):
        screen.print(part)
    shown = capsys.readouterr().out
    assert "2 tracks, last state: the first 1" in shown
    assert max(map(len, shown.splitlines())) <= width
    assert "…" not in shown
    assert ("target" in shown.split("2 clusters")[0]) == (width == 80)
    assert "Tracks cover 2 of 2 targets" in shown.replace("\n", " ")
