"""Text and HTML representations of values, and the `dechirp` accessor of xarray."""

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
import sample_studies
from dechirp.core.dimensions import DIMENSIONS
from dechirp.core.display import format_count_with_noun
from dechirp.core.table_columns import dataset_to_columns
from dechirp.core.text import format_quantity
from dechirp.experiments.study.run import StudyOutcome
from nightly import nightly, nightly_except

EXAMPLES = Path(dc.__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def mimo() -> dc.Scenario:
    return dc.load(EXAMPLES / "mimo.yaml", ["n_frames=1", "radar.frame.n_chirps=32"])


@pytest.fixture(scope="module")
def result(mimo) -> dc.Result:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        return dc.run(mimo)


class _CellParser(HTMLParser):
    """Parser that collects cell texts by row, and the tags of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.tags: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        assert not {name for name, _ in attrs} - {"style"}  # no attribute loads a resource
        if tag == "tr":
            self.rows.append([])

    def handle_data(self, data):
        if self.rows:
            self.rows[-1].append(data)


def parse_cells(value) -> list[list[str]]:
    return _CellParser(value._repr_html_()).rows


def test_radar_repr_shows_limits_in_readable_units(mimo):
    radar = mimo.radar

    assert repr(radar) == (
        "Radar(76.5 GHz, 256 MHz, 32 chirps of 256 samples, 3 x 4 elements:"
        " 0.586 m to 150 m, 1.13 m/s to ±18.1 m/s)"
    )
    assert radar.frame.chirp.range_resolution_m == pytest.approx(0.586, abs=5e-4)
    assert radar.frame.max_velocity_m_per_s == pytest.approx(18.1, abs=0.05)
    rows = {row[0]: row[1] for row in parse_cells(radar) if len(row) > 1}
    assert rows["slope"] == "20 MHz/µs"
    assert rows["noise factor"] == "12 dB"
    assert rows["tx 2"] == "0 m"


def test_radar_without_hardware_has_representation(mimo):
    radar = replace(mimo.radar, hardware=None)

    assert repr(radar) == repr(mimo.radar)
    assert "transmit power" not in radar._repr_html_()


def test_radar_with_single_chirp_shows_no_velocity(mimo):
    frame = replace(mimo.radar.frame, n_chirps=1)
    assert "m/s" not in repr(replace(mimo.radar, frame=frame))
    interval_frame = replace(mimo.radar.frame, interval_s=(18e-6, 20e-6))
    assert "1.13 m/s to ±18.1 m/s" in repr(interval_frame)  # of the first frame


def test_long_target_lists_are_abbreviated(mimo):
    road = dc.Scene(
        targets=[dc.Target(name=f"car {n}", position_m=(10 + n, 0, 0)) for n in range(50)]
    )

    assert repr(road) == "Scene(50 targets: car 0, car 1, car 2, ...)"
    rows = parse_cells(road)
    assert rows[1] == ["car 0", "10 m, 0 m, 0 m", "at rest", "0 dBsm"]
    assert len(rows) == 22
    assert rows[-1] == ["and 30 more"]


@pytest.mark.parametrize(
    "name",
    nightly_except(
        4,
        [
            "radar",
            "chain",
            "scene",
            "frame",
            "chirp",
            "array",
            "target",
            "result",
            "study",
            "design",
        ],
    ),
)
def test_repr_is_one_line_and_html_has_only_table_tags(name, mimo, result):
    value = {
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

    assert repr(value).startswith(f"{type(value).__name__}(")
    assert "\n" not in repr(value)
    assert len(repr(value)) < 160
    assert _CellParser(value._repr_html_()).tags <= {
        *("div", "p", "b", "table", "caption", "thead", "tbody", "tr", "td", "th")
    }


def test_user_names_are_escaped_in_html():
    scene = dc.Scene(targets=[dc.Target(name="<script>alert(1)</script>", position_m=(9, 0, 0))])

    assert "<script>" not in scene._repr_html_()
    assert parse_cells(scene)[1][0] == "<script>alert(1)</script>"


def test_study_shows_value_interval_and_theory_of_each_point():
    study_result, _ = sample_studies.make_result(sample_studies.RCS)

    assert repr(study_result) == "StudyResult(study: 7 points, 1,400 trials)"
    header, *rows = parse_cells(study_result)
    assert [row[0] for row in rows[:7]] == list(sample_studies.RCS.texts)
    text = rows[0][header.index("detection_probability")]
    value, low, high, theory = study_result.estimates["detection_probability"][0, 0]
    assert (
        text
        == f"{format_quantity(value, 'probability', 3)} ({format_quantity(low, 'probability', 3)}"
        f" to"
        + (
            f" {format_quantity(high, 'probability', 3)}),"
            f" {format_quantity(theory, 'probability', 3)}"
        )
    )
    outcome = StudyOutcome(study_result, ())
    assert repr(outcome) == "StudyOutcome(study: 7 points, 1,400 trials)"
    assert parse_cells(outcome) == parse_cells(study_result)


def test_cells_repr_is_constructor_call():
    cells = dc.Cells(range=10, velocity=8)
    assert repr(cells) == "Cells(range=10, velocity=8)"


def test_recording_repr_shows_file_format_and_frames(tmp_path, mimo):
    np.save(tmp_path / "cube.npy", np.ones((128, 128), complex))
    recording = dc.open(
        tmp_path / "cube.npy",
        radar=EXAMPLES / "radar.yaml",
        axes=("chirp", "sample"),
        encoding="full-scale",
    )

    assert repr(recording).startswith("Recording(cube.npy: npy, 1 frame, 7")
    assert "Chirp" in recording._repr_html_()


def test_detections_table_has_columns_of_csv_file(result):
    accessor = result.detections.dechirp

    assert repr(accessor).startswith(f"{result.detections.sizes['detection']} detections, range ")
    table = accessor.table()
    assert list(table) == list(dataset_to_columns(result.detections))
    assert table.range_m.tolist() == result.detections.range.values.tolist()
    np.testing.assert_allclose(table.azimuth_deg, np.degrees(result.detections.azimuth))
    header = parse_cells(accessor)[0]
    assert {"range_m", "azimuth_deg", "snr_db"} <= set(header)
    assert "cluster" not in header  # the chain has no clusters
    assert parse_cells(accessor)[1][header.index("frame")] == "0"


def test_empty_detections_give_empty_table(result):
    no_detections = result.detections.isel(detection=[])

    assert repr(no_detections.dechirp) == "0 detections"
    assert no_detections.dechirp.table().empty
    assert "<td" not in no_detections.dechirp._repr_html_()


def test_map_in_decibels_has_reference_unit(result):
    power = result.power

    level = power.dechirp.db()

    assert level.attrs["units"] == "dBm"
    peak = float(level.max())
    assert peak == pytest.approx(10 * np.log10(float(power.max())) + 30, abs=1e-6)
    assert level.velocity.attrs["units"] == "m/s"
    full_scale_level = power.assign_attrs(units="1").dechirp.db()
    assert full_scale_level.attrs["units"] == "dB"
    assert float(full_scale_level.max()) == pytest.approx(peak - 30, abs=1e-4)


def test_map_angles_are_converted_to_degrees(mimo, result):
    power = dc.range_azimuth_map(result.cube.isel(frame=0), mimo.radar)

    level = power.dechirp.db()

    np.testing.assert_allclose(level.azimuth, np.degrees(power.azimuth))
    assert level.azimuth.attrs["units"] == "deg"
    assert power.azimuth.attrs["units"] == "rad"


def test_rejects_decibels_of_cube(result):
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
def test_accessor_rejects_foreign_dataset(foreign):
    with pytest.raises(dc.InvalidSetting, match="detections, clusters, tracks, ego motion or"):
        foreign.dechirp.table()


@pytest.mark.parametrize(
    "foreign", [xr.Dataset(), xr.DataArray([1j]), xr.DataArray(["text"], attrs={"units": "W"})]
)
def test_accessor_of_foreign_arrays_answers_hasattr_and_is_displayed(foreign):
    assert hasattr(foreign, "dechirp")
    assert "expected" in repr(foreign.dechirp)
    for name in {"plot", "table", "db"} & set(dir(foreign.dechirp)):
        with pytest.raises(dc.InvalidSetting, match=r"^array\.dechirp: "):
            getattr(foreign.dechirp, name)()


def test_ego_motion_has_table():
    ego = xr.Dataset({"vx": ("frame", [3.0, 4.0]), "frame": [0, 1]})

    assert repr(ego.dechirp) == "2 frames"
    assert ego.dechirp.table().vx_m_per_s.tolist() == [3.0, 4.0]


def test_map_repr_shows_size_and_power_limits():
    power = xr.DataArray([[1e-12, 1e-9, 0.0]], dims=("a", "b"), attrs={"units": "W"})

    assert repr(power.dechirp) == "1 a x 3 b, \N{MINUS SIGN}270 to \N{MINUS SIGN}60 dBm"
    assert repr(power[:, :0].dechirp) == "no cells: 1 a x 0 b"


def test_html_formats_only_rows_that_it_shows(monkeypatch):
    targets = [dc.Target(name=f"car {n}", position_m=(10 + n, 0, 0)) for n in range(50)]
    formatted_targets = []
    cells_of = dc.Target._display_position_velocity_reflection
    monkeypatch.setattr(
        dc.Target,
        "_display_position_velocity_reflection",
        lambda target: formatted_targets.append(target) or cells_of(target),
    )

    dc.Scene(targets=targets)._repr_html_()
    assert len(formatted_targets) == 20


@nightly
@pytest.mark.parametrize(
    "expression",
    ["dc.truth(dc.Scene(), r)", "dc.detect(dc.simulate(dc.Scene(), r, seed=1), r)"],
)
def test_accessor_needs_no_extra_import(expression):
    """The package alone imports no xarray, and results of its functions have the accessor."""
    script = (
        "import sys, dechirp as dc\n"
        "assert 'xarray' not in sys.modules\n"
        "r = dc.reference(['radar.frame.n_chirps=16']).radar\n"
        f"print({expression}.dechirp)\n"
    )
    process = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script], text=True, capture_output=True, check=False
    )
    assert process.stderr == ""
    assert process.stdout.startswith("0 ")


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
def test_quantity_is_formatted_by_dimension(number, unit, text):
    assert format_quantity(number, unit) == text


@pytest.mark.parametrize("unit", DIMENSIONS)
def test_every_dimension_is_formatted(unit):
    for number in (0.0, 1e-9, 1.0, 1e12):
        assert format_quantity(number, unit)[0] in "0123456789\N{MINUS SIGN}"


@pytest.mark.parametrize(
    ("n", "noun", "text"),
    [
        (1, "chirp", "1 chirp"),
        (2048, "chirp", "2,048 chirps"),
        (0, "identity switch", "0 identity switches"),
    ],
)
def test_count_is_written_with_plural_of_its_noun(n, noun, text):
    assert format_count_with_noun(n, noun) == text
