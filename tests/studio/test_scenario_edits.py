"""Edits of settings by a page: accepted values, limits, and access to files."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiments.scenario import Scenario, load, reference
from dechirp.radar.calibration import Calibration
from dechirp.recordings.settings.calibration import format_calibration_json
from dechirp.studio.scenario_edits import (
    PageLimits,
    apply_overrides,
    check_scenario_within_limits,
    parse_scenario,
)
from nightly import nightly, nightly_except

DEFAULT_LIMITS = PageLimits()
REFERENCE_TEXT = dump_yaml(reference())
OPENED_PATHS: list[object] = []
"""Paths of all opened files; an audit hook cannot be removed from the process."""


def _record_opened_path(event: str, details: tuple[object, ...]) -> None:
    if event == "open":
        OPENED_PATHS.append(details[0])


sys.addaudithook(_record_opened_path)


def get_mistakes(text: str, limits: PageLimits = DEFAULT_LIMITS) -> tuple[Mistake, ...]:
    with pytest.raises(DechirpError) as error:
        parse_scenario(text, limits)
    return error.value.mistakes


def get_option_mistake(
    option: str, limits: PageLimits = DEFAULT_LIMITS, scenario: Scenario | None = None
) -> Mistake:
    with pytest.raises(DechirpError) as error:
        apply_overrides(scenario or reference(), [option], limits)
    return error.value.mistakes[0]


def test_dumped_scenario_parses_to_itself() -> None:
    assert parse_scenario(REFERENCE_TEXT, DEFAULT_LIMITS) == reference()


def test_edits_equal_options_of_command_line() -> None:
    options = ["radar.frame.chirp.slope=19 MHz/us", "scene.targets.car.rcs=3 dBsm", "tracker={}"]
    small_options = ["radar.array.rx=[[0, 0, 0], [0, 2 mm, 0]]", "n_frames=5", *options]
    scenario = apply_overrides(reference(), small_options, DEFAULT_LIMITS)
    assert scenario == reference(small_options)


def test_dependent_settings_are_changed_together() -> None:
    options = ["chain.cfar.false_alarm_probability=null", "chain.cfar.offset=15 dB"]
    scenario = apply_overrides(reference(), options, DEFAULT_LIMITS)
    assert scenario.chain.cfar.offset == pytest.approx(10**1.5)
    assert get_option_mistake(options[1]).setting == "chain.cfar.false_alarm_probability"


@pytest.mark.parametrize(
    ("path", "text"),
    nightly_except(
        10,
        [
            ("radar.frame.chirp.slope", "20"),  # no unit
            ("radar.frame.chirp.slope", "20 MHz"),  # unit of another quantity
            ("radar.frame.chirp.slope", "nan"),
            ("radar.frame.chirp.slope", ".inf"),
            ("radar.frame.chirp.slope", "1e999 MHz/us"),
            ("radar.frame.chirp.slope", "1e30 MHz/us"),  # beyond any radar
            ("radar.frame.chirp.slope", "0 MHz/us"),
            ("radar.frame.chirp.slope", ""),
            ("radar.frame.chirp.slope", "__import__('os').system('true')"),
            ("radar.frame.chirp.slope", "2 * 10 MHz/us"),
            ("radar.frame.chirp.slope", "!!python/object/apply:os.system ['true']"),
            ("radar.frame.chirp.slope", "!!float 3"),
            ("radar.frame.chirp.slope", "&a 20 MHz/us"),
            ("radar.frame.chirp.slope", "*a"),
            ("radar.frame.chirp.slope", "{a: b"),
            ("radar.frame.chirp.slope", "[" * 40 + "]" * 40),
            ("radar.frame.chirp.slope", "1" * 200 + " MHz/us"),
            ("radar.frame.chirp.slope", "20 MHz/us\n---\n3"),
            ("radar.frame.chirp.n_samples", "3.5"),
            ("radar.frame.chirp.n_samples", "'256'"),
            ("radar.frame.chirp.n_samples", "1"),
            ("radar.frame.chirp.sampling", "both"),
            ("radar.frame.n_chirps", "-1"),
            ("chain.cfar.estimator.kind", "clairvoyant"),
            ("chain.cfar.false_alarm_probability", "2"),
            ("scene.targets.car.position", "[50 m, 0 m]"),
            ("scene.targets.car.fluctuation", "swerling-9"),
            ("seed", "-1"),
            ("no.such.setting", "1"),
        ],
    ),
)
def test_rejects_invalid_value_with_name_of_setting(path: str, text: str) -> None:
    mistake = get_option_mistake(f"{path}={text}")
    assert path.startswith(mistake.setting)
    assert mistake.value and mistake.expected and mistake.fix
    assert mistake.line is None  # options have no line


def test_all_mistakes_of_text_have_line_and_column() -> None:
    text = REFERENCE_TEXT.replace("n_samples: 2200", "n_samples: many").replace("10 dBsm", "10 dBi")
    positions = {mistake.setting: (mistake.line, mistake.column) for mistake in get_mistakes(text)}
    lines = text.splitlines()
    for setting, value in (
        ("radar.frame.chirp.n_samples", "many"),
        ("scene.targets.car.rcs", "10 dBi"),
    ):
        line, column = positions[setting]
        assert line and column and lines[line - 1][column - 1 :].startswith(value)


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\nb: [*a, *a]",
        "!!python/name:os.system",
        "[" * 10_000,
        "name: " + "a" * 70_000,
        "{" + ", ".join(f"k{n}: {n}" for n in range(9000)) + "}",
        "",
        "- 1",
        "\x00",
        'name: "\\U00110000"',
    ],
)
def test_rejects_text_that_is_not_settings(text: str) -> None:
    assert all(mistake.value and mistake.expected and mistake.fix for mistake in get_mistakes(text))


@pytest.mark.parametrize(
    ("setting", "option"),
    nightly_except(2, [
        ("radar.frame", "radar.frame.n_chirps=1000000000"),
        ("radar.frame", "radar.frame.chirp={start_frequency: 77 GHz, slope: 1 Hz/s, sampling: real,"
         " ramp_duration: 1000 s, sample_rate: 10 GHz, n_samples: 1000000000}"),
        ("n_frames", "n_frames=1000000"),
        ("chain", "chain.n_range_bins=2000000000"),
        ("chain", "chain.n_velocity_bins=1000000"),
        ("scene.targets", "scene.targets.car={name: car, position: [9 m, 0, -1 m],"
         " body: {kind: ground-clutter, n_patches: 10000000}}"),
        ("scene.targets", f"scene.targets=[{', '.join(['{position: [9 m, 0, 0]}'] * 101)}]"),
        ("impairments", "impairments=[{kind: rain-backscatter, rate: 3 mm/h,"
         " n_scatterers: 9999999}]"),
    ]),
)  # fmt: skip
def test_rejects_request_above_page_limits_before_computation(setting: str, option: str) -> None:
    # Each request would take gigabytes or minutes, which all pages share.
    slow_scenario = replace(reference(), radar=lengthen_interval(reference()))
    mistake = get_option_mistake(option, scenario=slow_scenario)
    assert mistake.setting == setting
    assert "on this page" in mistake.expected


def lengthen_interval(scenario: Scenario) -> dc.Radar:
    assert scenario.radar is not None
    return replace(scenario.radar, frame=replace(scenario.radar.frame, interval_s=2000.0))


def test_text_above_page_limits_gives_line_of_setting() -> None:
    (mistake,) = get_mistakes(REFERENCE_TEXT.replace("n_chirps: 128", "n_chirps: 100000"))
    assert mistake.setting == "radar.frame"
    assert mistake.line == 1 + REFERENCE_TEXT.splitlines().index("  frame:")


def test_computed_scenarios_obey_same_limits() -> None:
    assert check_scenario_within_limits(reference(), DEFAULT_LIMITS).radar == reference().radar
    with pytest.raises(DechirpError, match="281,600 samples"):
        check_scenario_within_limits(reference(), PageLimits(max_samples=281_599))


@nightly
def test_total_number_of_mesh_rays_is_limited(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((2.0, 1.0, 1.0)).export(tmp_path / "box.stl")  # 2.45 m across
    limits = PageLimits(folders=(tmp_path,))

    def mesh_option(*spacings: str) -> str:
        body = "body: {{kind: mesh, path: box.stl, rays: {{spacing: {}}}}}"
        targets = (f"{{position: [9 m, 0, 0], {body.format(spacing)}}}" for spacing in spacings)
        return f"scene.targets=[{{name: car, position: [9 m, 0, 0]}}, {', '.join(targets)}]"

    scenario = apply_overrides(reference(), [mesh_option("1 mm")], limits)
    assert scenario.scene is not None
    for option, n_rays in ((mesh_option("1 um"), 6e12), (mesh_option(*4 * ["1 mm"]), 24e6)):
        mistake = get_option_mistake(option, limits)
        number, quantity = mistake.value.split(" ", 1)
        assert float(number.replace(",", "")) == pytest.approx(n_rays, rel=1e-2)
        assert (mistake.setting, quantity) == ("scene.targets", "rays onto meshes")
        assert "20,000,000 on this page" in mistake.expected


# Files.


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    captures = tmp_path / "given"
    captures.mkdir()
    for directory in (tmp_path, captures):
        (directory / "radar.yaml").write_text(dump_yaml(reference().radar))
        (directory / "calibration.json").write_text(
            format_calibration_json(make_ideal_calibration())
        )
        (directory / "mesh.stl").write_text("solid\nendsolid\n")
        (directory / "capture.bin").write_bytes(b"")
    return captures


def make_ideal_calibration() -> Calibration:
    return Calibration(elements=((0, 0),), gain=((1.0, 0.0),))


def options_naming_files(path: str) -> list[str]:
    return [
        f"radar={path}/radar.yaml",
        f"radar.calibration={path}/calibration.json",
        f"scene.targets.car={{position: [9 m, 0, 0], body: {{kind: mesh, path: {path}/mesh.stl}}}}",
        f"recording={{path: {path}/capture.bin}}",
        f"recording={{path: capture.bin, settings_path: {path}/radar.yaml}}",
        f"recording={{path: capture.bin, calibration: {path}/calibration.json}}",
    ]


def test_file_names_are_resolved_in_first_folder(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    assert parse_scenario(text_naming_radar("radar.yaml"), limits) == reference()
    assert apply_overrides(reference(), ["radar=radar.yaml"], limits) == reference()
    calibrated = apply_overrides(reference(), ["radar.calibration=calibration.json"], limits)
    assert calibrated.radar is not None and calibrated.radar.calibration == make_ideal_calibration()


def text_naming_radar(path: str) -> str:
    return f"radar: '{path}'\n{dump_yaml(reference(), omitted_settings=['radar'])}"


@pytest.mark.parametrize(
    "place", nightly_except(2, ["..", "{outside}", "out", "sub/../..", "./out/../.."])
)
def test_rejects_outside_files_in_any_form_without_opening_them(folder: Path, place: str) -> None:
    outside, scenario = folder.parent, reference()
    (folder / "out").symlink_to(outside)
    (folder / "sub").mkdir()
    limits = PageLimits(folders=(folder,))
    OPENED_PATHS.clear()
    for option in options_naming_files(place.format(outside=outside)):
        mistake = get_option_mistake(option, limits, scenario)
        assert "folders of the studio" in mistake.expected, option
        assert mistake.setting.startswith(option.partition("=")[0].partition(".")[0])
        names = {Path(str(path)).name for path in OPENED_PATHS}
        assert not names & {"radar.yaml", "calibration.json", "mesh.stl", "capture.bin"}, option


def test_rejects_links_to_outside(folder: Path) -> None:
    (folder / "link.yaml").symlink_to(folder.parent / "radar.yaml")
    assert (
        "folders" in get_option_mistake("radar=link.yaml", PageLimits(folders=(folder,))).expected
    )
    (folder / "circle.yaml").symlink_to("circle.yaml")
    assert get_option_mistake("radar=circle.yaml", PageLimits(folders=(folder,))).setting == "radar"


def test_rejects_recording_folder_with_links_to_outside(folder: Path) -> None:
    (folder / "day").mkdir()
    (folder / "day" / "config.json").symlink_to(folder.parent / "capture.bin")
    (mistake,) = get_mistakes("recording: {path: day}\n", PageLimits(folders=(folder,)))
    assert mistake.setting == "recording.path" and "folders of the studio" in mistake.expected


def test_rejects_inside_file_that_names_outside_file(folder: Path) -> None:
    text = dump_yaml(reference().radar) + "calibration: ../calibration.json\n"
    (folder / "nested.yaml").write_text(text)
    limits = PageLimits(folders=(folder,))
    assert get_option_mistake("radar=nested.yaml", limits).setting == "calibration"
    option = f"recording={{path: capture.bin, settings_path: {folder}/nested.yaml}}"
    assert get_option_mistake(option, limits).setting == "calibration"


def test_option_does_not_give_next_option_access_to_outside(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    options = [f"radar={folder.parent}/radar.yaml", "radar.frame.n_chirps=64"]
    with pytest.raises(DechirpError, match="folders of the studio"):
        apply_overrides(reference(), options, limits)


@pytest.mark.parametrize("address", ["udp://0.0.0.0:4098", "file:///etc/passwd", "http://a.b/c"])
def test_rejects_network_addresses(folder: Path, address: str) -> None:
    text = f"recording: {{path: '{address}'}}\nscene: null\n"
    (mistake,) = get_mistakes(text, PageLimits(folders=(folder,)))
    assert mistake.setting == "recording.path"
    assert mistake.value == address
    assert (mistake.line, mistake.column) == (1, 19)


@pytest.mark.parametrize("path", ["a\\0b", "a" * 5000, "~/radar.yaml", "/dev/zero", "."])
def test_rejects_invalid_file_names(folder: Path, path: str) -> None:
    assert get_option_mistake(f'radar="{path}"', PageLimits(folders=(folder,))).fix


def test_rejects_all_file_names_without_folders(tmp_path: Path) -> None:
    file = tmp_path / "radar.yaml"
    file.write_text(dump_yaml(reference().radar))
    assert "none was given" in get_option_mistake(f"radar={file}").expected


def test_saved_text_with_recording_loads_from_other_folder(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    scenario = parse_scenario("recording: {path: capture.bin}\n", limits)
    saved_file = folder.parent / "saved.yaml"
    saved_file.write_text(dump_yaml(scenario))
    assert load(saved_file) == scenario
