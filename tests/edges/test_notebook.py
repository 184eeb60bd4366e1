"""What values show of themselves: one line in a terminal, tables in a notebook."""

import subprocess
import sys
import warnings
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
import study_made
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.table_columns import dataset_to_columns
from dechirp.core.text import format_quantity
from dechirp.experiments.study.run import StudyOutcome

EXAMPLES = Path(dc.__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def mimo() -> dc.Scenario:
    return dc.load(EXAMPLES / "mimo.yaml", ["n_frames=1", "radar.frame.n_chirps=32"])


@pytest.fixture(scope="module")
def result(mimo) -> dc.Result:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        return dc.run(mimo)


class _Cells(HTMLParser):
    """Texts of the cells, row by row, and the tags that are open."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.tags: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        assert not {name for name, _ in attrs} - {"style"}  # nothing is asked for elsewhere
        if tag == "tr":
            self.rows.append([])

    def handle_data(self, data):
        if self.rows:
            self.rows[-1].append(data)


def cells(thing) -> list[list[str]]:
    return _Cells(thing._repr_html_()).rows


def test_a_radar_says_its_reach_in_the_units_of_people(mimo):
    radar = mimo.radar

    assert repr(radar) == (
        "Radar(76.5 GHz, 256 MHz, 32 chirps of 256 samples, 3 x 4 elements:"
        " 0.586 m to 150 m, 1.13 m/s to ±18.1 m/s)"
    )
    assert radar.frame.chirp.range_resolution_m == pytest.approx(0.586, abs=5e-4)
    assert radar.frame.max_velocity_m_per_s == pytest.approx(18.1, abs=0.05)
    shown = {row[0]: row[1] for row in cells(radar) if len(row) > 1}
    assert shown["slope"] == "20 MHz/µs"
    assert shown["noise factor"] == "12 dB"
    assert shown["tx 2"] == "0 m"


def test_a_radar_without_hardware_is_shown_as_well(mimo):
    bare = replace(mimo.radar, hardware=None)

    assert repr(bare) == repr(mimo.radar)
    assert "transmit power" not in bare._repr_html_()


def test_a_radar_that_tells_no_velocity_says_none(mimo):
    frame = replace(mimo.radar.frame, n_chirps=1)
    assert "m/s" not in repr(replace(mimo.radar, frame=frame))
    many = replace(mimo.radar.frame, interval_s=(18e-6, 20e-6))
    assert "1.13 m/s to ±18.1 m/s" in repr(many)  # of the first frame


def test_long_lists_are_counted(mimo):
    road = dc.Scene(
        targets=[dc.Target(name=f"car {n}", position_m=(10 + n, 0, 0)) for n in range(50)]
    )

    assert repr(road) == "Scene(50 targets: car 0, car 1, car 2, ...)"
    rows = cells(road)
    assert rows[1] == ["car 0", "10 m, 0 m, 0 m", "at rest", "0 dBsm"]
    assert len(rows) == 22
    assert rows[-1] == ["and 30 more"]


@pytest.mark.parametrize(
    "name",
    ["radar", "chain", "scene", "frame", "chirp", "array", "target", "result", "study", "design"],
)
def test_a_line_is_one_and_a_page_asks_for_nothing(name, mimo, result):
    thing = {
        "radar": mimo.radar,
        "chain": mimo.chain,
        "scene": mimo.scene,
        "frame": mimo.radar.frame,
        "chirp": mimo.radar.frame.chirp,
        "array": mimo.radar.array,
        "target": mimo.scene.targets[0],
        "result": result,
        "study": dc.load_study(EXAMPLES / "studies" / "stress-test.yaml"),
        "design": dc.design(
            max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100, rcs_m2=1
        ),
    }[name]

    assert repr(thing).startswith(f"{type(thing).__name__}(")
    assert "\n" not in repr(thing)
    assert len(repr(thing)) < 160
    assert _Cells(thing._repr_html_()).tags <= {
        *("div", "p", "b", "table", "caption", "thead", "tbody", "tr", "td", "th")
    }


def test_what_a_user_named_is_text_and_no_page():
    scene = dc.Scene(targets=[dc.Target(name="<script>alert(1)</script>", position_m=(9, 0, 0))])

    assert "<script>" not in scene._repr_html_()
    assert cells(scene)[1][0] == "<script>alert(1)</script>"


def test_a_study_shows_value_interval_and_theory_of_each_point():
    found, _ = study_made.result(study_made.RCS)

    assert repr(found) == "StudyResult(study: 7 points, 1,400 trials)"
    head, *rows = cells(found)
    assert [row[0] for row in rows[:7]] == list(study_made.RCS.texts)
    text = rows[0][head.index("detection_probability")]
    value, low, high, theory = found.estimates["detection_probability"][0, 0]
    assert (
        text
        == f"{format_quantity(value, 'probability', 3)} ({format_quantity(low, 'probability', 3)}"
        f" to"
        + (
            f" {format_quantity(high, 'probability', 3)}),"
            f" {format_quantity(theory, 'probability', 3)}"
        )
    )
    finished = StudyOutcome(found, ())
    assert repr(finished) == "StudyOutcome(study: 7 points, 1,400 trials)"
    assert cells(finished) == cells(found)


def test_other_values_keep_what_makes_them_again():
    cells = dc.Cells(range=10, velocity=8)
    assert repr(cells) == "Cells(range=10, velocity=8)"


def test_a_recording_says_what_it_is(tmp_path, mimo):
    np.save(tmp_path / "cube.npy", np.ones((128, 128), complex))
    recording = dc.open(
        tmp_path / "cube.npy",
        radar=EXAMPLES / "radar.yaml",
        axes=("chirp", "sample"),
        encoding="full-scale",
    )

    assert repr(recording).startswith("Recording(cube.npy: npy, 1 frame, 7")
    assert "Chirp" in recording._repr_html_()


def test_detections_are_shown_with_the_columns_of_their_file(result):
    found = result.detections.dechirp

    assert repr(found).startswith(f"{result.detections.sizes['detection']} detections, range ")
    table = found.table()
    assert list(table) == list(dataset_to_columns(result.detections))
    assert table.range_m.tolist() == result.detections.range.values.tolist()
    np.testing.assert_allclose(table.azimuth_deg, np.degrees(result.detections.azimuth))
    head = cells(found)[0]
    assert {"range_m", "azimuth_deg", "snr_db"} <= set(head)
    assert "cluster" not in head  # none were asked for
    assert cells(found)[1][head.index("frame")] == "0"


def test_no_detections_are_shown_as_none(result):
    none = result.detections.isel(detection=[])

    assert repr(none.dechirp) == "0 detections"
    assert none.dechirp.table().empty
    assert "<td" not in none.dechirp._repr_html_()


def test_a_map_in_decibels_says_over_what(result):
    power = result.power

    level = power.dechirp.db()

    assert level.attrs["units"] == "dBm"
    peak = float(level.max())
    assert peak == pytest.approx(10 * np.log10(float(power.max())) + 30, abs=1e-6)
    assert level.velocity.attrs["units"] == "m/s"
    full = power.assign_attrs(units="full scale squared").dechirp.db()
    assert full.attrs["units"] == "dBFS"
    assert float(full.max()) == pytest.approx(peak - 30, abs=1e-4)


def test_angles_of_a_map_are_told_in_degrees(mimo, result):
    power = dc.range_azimuth_map(result.cube.isel(frame=0), mimo.radar)

    level = power.dechirp.db()

    np.testing.assert_allclose(level.azimuth, np.degrees(power.azimuth))
    assert level.azimuth.attrs["units"] == "deg"
    assert power.azimuth.attrs["units"] == "rad"


def test_what_is_no_map_is_refused(result):
    with pytest.raises(dc.InvalidSetting, match="a power map in W"):
        result.cube.dechirp.db()


@pytest.mark.parametrize(
    "foreign",
    [
        xr.Dataset(),
        xr.Dataset({"power": ("x", [1.0])}),
        xr.Dataset({"label": ("detection", ["car"])}),
        xr.Dataset({"range": (("track", "frame"), np.ones((2, 2)))}),
    ],
)
def test_a_dataset_that_is_none_of_ours_is_refused(foreign):
    with pytest.raises(dc.InvalidSetting, match="detections, clusters, tracks, ego motion or"):
        _ = foreign.dechirp


def test_own_motion_is_a_table_as_well():
    ego = xr.Dataset({"vx": ("frame", [3.0, 4.0]), "frame": [0, 1]})

    assert repr(ego.dechirp) == "2 frames"
    assert ego.dechirp.table().vx_m_per_s.tolist() == [3.0, 4.0]


def test_a_map_says_its_size_and_its_ends():
    power = xr.DataArray([[1e-12, 1e-9, 0.0]], dims=("a", "b"), attrs={"units": "W"})

    assert repr(power.dechirp) == "1 a x 3 b, \N{MINUS SIGN}270 to \N{MINUS SIGN}60 dBm"
    assert repr(power[:, :0].dechirp) == "no cells: 1 a x 0 b"


def test_a_page_makes_no_rows_that_it_leaves_out(monkeypatch):
    targets = [dc.Target(name=f"car {n}", position_m=(10 + n, 0, 0)) for n in range(50)]
    asked = []
    cells_of = dc.Target._summary_cells
    monkeypatch.setattr(dc.Target, "_summary_cells", lambda one: asked.append(one) or cells_of(one))

    dc.Scene(targets=targets)._repr_html_()
    assert len(asked) == 20


@pytest.mark.parametrize(
    "made",
    ["dc.detect(dc.simulate(dc.Scene(), r, seed=1), r)", "dc.truth(dc.Scene(), r)"],
)
def test_whoever_has_an_array_of_ours_has_the_accessor(made):
    """Without importing anything else, and the package alone loads no xarray."""
    script = (
        "import sys, dechirp as dc\n"
        "assert 'xarray' not in sys.modules\n"
        "r = dc.reference(['radar.frame.n_chirps=16']).radar\n"
        f"print({made}.dechirp)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script], text=True, capture_output=True, check=False
    )
    assert ended.stderr == ""
    assert ended.stdout.startswith("0 ")


@pytest.mark.parametrize(
    ("number", "unit", "text"),
    [
        (77e9, "hz", "77 GHz"),
        (20e12, "hz_per_s", "20 MHz/µs"),
        (0.586, "m", "0.586 m"),
        (0.0039, "m", "3.9 mm"),
        (2e-6, "s", "2 µs"),
        (10**-1.8, "w", "12 dBm"),
        (10.0, "m2", "10 dBsm"),
        (0.0, "m2", "0 m²"),
        (np.pi / 6, "rad", "30°"),
        (2.0, "m_per_s2", "2 m/s²"),
        (1e-6, "probability", "10⁻⁶"),
        (9.999e-7, "probability", "10⁻⁶"),
        (2.5e-323, "probability", "2.47 \N{MULTIPLICATION SIGN} 10⁻³²³"),
        (0.9, "probability", "0.9"),
        (100.0, None, "20 dB"),
    ],
)
def test_a_number_is_told_as_its_kind_is(number, unit, text):
    assert format_quantity(number, unit) == text


@pytest.mark.parametrize("unit", DIMENSIONS)
def test_every_kind_of_number_can_be_told(unit):
    for number in (0.0, 1e-9, 1.0, 1e12):
        assert format_quantity(number, unit)[0] in "0123456789\N{MINUS SIGN}"
