"""Clusters, ego motion and tracks in the report and in terminal output."""

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.console import open_stdout_console
from dechirp.cli.run_output import track_table_and_object_sentences
from dechirp.report import objects_section
from dechirp.report.figures import tracks as figure
from dechirp.report.page import render_report
from nightly import nightly
from radars import eight_receiver_radar

RADAR = eight_receiver_radar(period_s=0.05)
TARGETS = (
    dc.Target(name="left", position_m=(30, 6, 0), velocity_m_per_s=(-8, 0, 0)),
    dc.Target(name="right", position_m=(20, -5, 0), velocity_m_per_s=(6, 1, 0)),
)


def run_scenario(**changes) -> dc.Result:
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
    return run_scenario()


def parse_object_rows(page: str) -> list[list[str]]:
    section = page[page.index('<section id="objects">') :]
    body = section[section.index("<tbody>") : section.index("</tbody>")]
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall("<tr>.*?</tr>", body)]


@pytest.mark.usefixtures("without_figures")
def test_track_table_shows_last_state_and_target(result):
    rows = parse_object_rows(render_report(result, yaml=""))

    last_positions_m = result.scenario.scene.target_positions_m(result.truth.time.values[-1:])[0]
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
        index = ("left", "right").index(name)
        position, velocity = last_positions_m[index], TARGETS[index].velocity_m_per_s
        # Six standard errors, and the rounding.
        assert abs(x - position[0]) < 6 * x_std + 0.05 and abs(y - position[1]) < 6 * y_std + 0.05
        assert abs(vx - velocity[0]) < 1.5
        assert result.tracks.x.sel(track=int(number)).values[-1] == pytest.approx(x, abs=0.051)


@pytest.mark.usefixtures("without_figures")
def test_report_counts_tracks_and_clusters(result):
    page = render_report(result, yaml="")
    assert "Tracks cover 2 of 2 targets, one each." in page
    assert f"{result.clusters.sizes['cluster']} clusters of" in page
    assert "2 tracks confirmed in 6 frames." in page
    assert "unscented filter, joint association" in page
    assert 'id="objects"' not in render_report(
        run_scenario(tracker=None, chain=dc.Chain()), yaml=""
    )


@nightly
def test_track_figure_labels_tracks_and_truth(result):
    page = render_report(result, yaml="")
    svg = page[page.index('aria-label="Tracks from above"') :]
    svg = svg[: svg.index("</svg>")]
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    assert {"0", "1", "truth", "track", "detection", "y (m, left positive)"} <= set(texts)


@nightly
def test_figure_shows_longest_of_many_tracks(result):
    short_tracks = result.tracks.isel(track=[0] * 100)
    short_tracks["status"] = short_tracks.status.where(short_tracks.frame < 4, "")
    all_tracks = xr.concat([short_tracks, result.tracks], "track").assign_coords(
        track=np.arange(102)
    )
    page = render_report(replace(result, tracks=all_tracks), yaml="")
    svg = page[page.index('aria-label="Tracks from above"') :].split("</svg>")[0]

    assert "Shown are the 60 longest of 102 tracks." in page
    numbers = set(re.findall(r">(\d+)</text>", svg))
    # The two tracks that last to the end, and the first of the shorter ones.
    assert {"0", "57", "100", "101"} <= numbers and not {"58", "99"} & numbers
    assert "The table contains the first 50 tracks; all are in" in page


def test_track_ellipse_follows_covariance():
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    line = figure.TrackLine(
        number=0,
        positions_m=np.zeros((1, 2)),
        is_confirmed=np.array([True]),
        velocity_m_per_s=np.zeros(2),
        covariance_m2=covariance,
    )
    ellipse_m = line.error_ellipse_m()
    # Each point is one standard error from the centre; the extent along x and y follows.
    distance2 = np.einsum("in,ij,jn->n", ellipse_m, np.linalg.inv(covariance), ellipse_m)
    assert distance2 == pytest.approx(1.0)
    assert abs(ellipse_m).max(axis=1) == pytest.approx([2.0, 1.0], rel=2e-3)


def test_track_that_switches_target_lists_both_targets(result):
    tracks = result.tracks.copy(deep=True)
    right = [names[0] for names in objects_section.target_names_per_track(result, tracks)].index(
        "right"
    )
    positions_m = result.scenario.scene.target_positions_m(result.truth.time.values)[:, 0]
    for name, column in zip("xy", positions_m.T, strict=False):
        tracks[name].values[right, 4:] = column[4:]

    assert objects_section.target_names_per_track(result, tracks)[right] == ["right", "left"]


def test_track_far_from_all_targets_has_no_target(result):
    shifted_tracks = result.tracks.assign(x=result.tracks.x + 8.0)
    assert objects_section.target_names_per_track(result, shifted_tracks) == [[], []]


def test_tracks_without_truth_have_no_targets(result):
    recorded_result = replace(result, truth=None)
    assert objects_section.describe_number_of_targets_with_tracks(recorded_result) == ""
    assert [row["target"] for row in objects_section.track_table_rows(recorded_result, 5)] == [
        "\N{EN DASH}"
    ] * 2


@nightly
def test_report_without_tracks_has_no_figure(result):
    empty_result = run_scenario(scene=dc.Scene(targets=()))
    assert empty_result.tracks.sizes["track"] == 0
    page = render_report(empty_result, yaml="")
    assert "0 tracks confirmed" in page and 'aria-label="Tracks from above"' not in page


@pytest.mark.parametrize("width", [80, 60])
def test_terminal_output_of_tracks_fits_width(result, width, capsys):
    console = open_stdout_console()
    console.width = width
    for part in track_table_and_object_sentences(result, at_most=1, width=width):
        console.print(part)
    output = capsys.readouterr().out
    assert "2 tracks, last state: the first 1" in output
    table = output.split("2 clusters")[0]
    assert max(map(len, table.splitlines())) <= width
    assert "…" not in output
    assert ("target" in output.split("2 clusters")[0]) == (width == 80)
    assert "Tracks cover 2 of 2 targets" in output
