"""What a page may write into its settings, and what it is refused."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiments.scenario import Scenario, load, reference
from dechirp.radar.calibration import Calibration
from dechirp.recordings.settings.calibration import format_calibration_json
from dechirp.studio.scenario_edits import (
    PageLimits,
    apply_options,
    check_scenario_size,
    parse_scenario,
)

NONE = PageLimits()
REFERENCE = dump(reference())
OPENED: list[object] = []
"""All that is opened, by whatever means; a hook stays for the life of the process."""


def _hear(event: str, details: tuple[object, ...]) -> None:
    if event == "open":
        OPENED.append(details[0])


sys.addaudithook(_hear)


def mistakes(text: str, limits: PageLimits = NONE) -> tuple[Mistake, ...]:
    with pytest.raises(DechirpError) as refused:
        parse_scenario(text, limits)
    return refused.value.mistakes


def refused(option: str, limits: PageLimits = NONE, of: Scenario | None = None) -> Mistake:
    with pytest.raises(DechirpError) as error:
        apply_options(of or reference(), [option], limits)
    return error.value.mistakes[0]


def test_the_text_of_settings_comes_back_as_the_scenario_that_it_was_written_of() -> None:
    assert parse_scenario(REFERENCE, NONE) == reference()


def test_a_change_gives_what_set_gives_on_the_command_line() -> None:
    options = ["radar.frame.chirp.slope=19 MHz/us", "scene.targets.car.rcs=3 dBsm", "tracker={}"]
    small = ["radar.array.rx=[[0, 0, 0], [0, 2 mm, 0]]", "n_frames=5", *options]
    made = apply_options(reference(), small, NONE)
    assert made == reference(small)


def test_settings_that_only_fit_together_are_changed_together() -> None:
    both = ["chain.cfar.false_alarm_probability=null", "chain.cfar.offset=15 dB"]
    made = apply_options(reference(), both, NONE)
    assert made.chain.cfar.offset == pytest.approx(10**1.5)
    assert refused(both[1]).setting == "chain.cfar.false_alarm_probability"


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("radar.frame.chirp.slope", "20"),  # no unit
        ("radar.frame.chirp.slope", "20 MHz"),  # that of something else
        ("radar.frame.chirp.slope", "nan"),
        ("radar.frame.chirp.slope", ".inf"),
        ("radar.frame.chirp.slope", "1e999 MHz/us"),
        ("radar.frame.chirp.slope", "1e30 MHz/us"),  # no radar's
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
)
def test_what_is_no_value_of_a_setting_is_refused_by_the_name_of_the_setting(
    path: str, text: str
) -> None:
    mistake = refused(f"{path}={text}")
    assert path.startswith(mistake.setting)
    assert mistake.value and mistake.expected and mistake.fix
    assert mistake.line is None  # of a text that nobody has seen


def test_mistakes_of_a_text_tell_line_and_column_all_at_once() -> None:
    text = REFERENCE.replace("n_samples: 2200", "n_samples: many").replace("10 dBsm", "10 dBi")
    found = {one.setting: (one.line, one.column) for one in mistakes(text)}
    lines = text.splitlines()
    for setting, written in (
        ("radar.frame.chirp.n_samples", "many"),
        ("scene.targets.car.rcs", "10 dBi"),
    ):
        line, column = found[setting]
        assert line and column and lines[line - 1][column - 1 :].startswith(written)


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
def test_texts_that_are_no_settings_are_refused_with_words(text: str) -> None:
    assert all(one.value and one.expected and one.fix for one in mistakes(text))


@pytest.mark.parametrize(
    ("setting", "option"),
    [
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
    ],
)  # fmt: skip
def test_more_than_a_page_may_ask_for_is_refused_before_it_is_begun(
    setting: str, option: str
) -> None:
    """Each of them would take gigabytes, or minutes, of all pages."""
    patient = replace(reference(), radar=replace_interval(reference()))
    mistake = refused(option, of=patient)
    assert mistake.setting == setting
    assert "on this page" in mistake.expected


def replace_interval(scenario: Scenario) -> dc.Radar:
    assert scenario.radar is not None
    return replace(scenario.radar, frame=replace(scenario.radar.frame, interval_s=2000.0))


def test_a_text_that_asks_for_too_much_says_where() -> None:
    (mistake,) = mistakes(REFERENCE.replace("n_chirps: 128", "n_chirps: 100000"))
    assert mistake.setting == "radar.frame"
    assert mistake.line == 1 + REFERENCE.splitlines().index("  frame:")


def test_what_functions_make_of_settings_is_within_the_same_limits() -> None:
    assert check_scenario_size(reference(), NONE).radar == reference().radar
    with pytest.raises(DechirpError, match="281,600 samples"):
        check_scenario_size(reference(), PageLimits(max_samples=281_599))


def test_meshes_ask_for_so_many_rays_together_and_no_more(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((2.0, 1.0, 1.0)).export(tmp_path / "box.stl")  # 2.45 m across
    limits = PageLimits(folders=(tmp_path,))

    def meshes(*spacings: str) -> str:
        body = "body: {{kind: mesh, path: box.stl, rays: {{spacing: {}}}}}"
        of = (f"{{position: [9 m, 0, 0], {body.format(one)}}}" for one in spacings)
        return f"scene.targets=[{{name: car, position: [9 m, 0, 0]}}, {', '.join(of)}]"

    held = apply_options(reference(), [meshes("1 mm")], limits)
    assert held.scene is not None
    for option, n_rays in ((meshes("1 um"), 6e12), (meshes(*4 * ["1 mm"]), 24e6)):
        mistake = refused(option, limits)
        number, words = mistake.value.split(" ", 1)
        assert float(number.replace(",", "")) == pytest.approx(n_rays, rel=1e-2)
        assert (mistake.setting, words) == ("scene.targets", "rays onto meshes")
        assert "20,000,000 on this page" in mistake.expected


# Files.


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inside = tmp_path / "given"
    inside.mkdir()
    for place in (tmp_path, inside):
        (place / "radar.yaml").write_text(dump(reference().radar))
        (place / "calibration.json").write_text(format_calibration_json(ideal()))
        (place / "mesh.stl").write_text("solid\nendsolid\n")
        (place / "capture.bin").write_bytes(b"")
    return inside


def ideal() -> Calibration:
    return Calibration(elements=((0, 0),), gain=((1.0, 0.0),))


def options_naming(path: str) -> list[str]:
    return [
        f"radar={path}/radar.yaml",
        f"radar.calibration={path}/calibration.json",
        f"scene.targets.car={{position: [9 m, 0, 0], body: {{kind: mesh, path: {path}/mesh.stl}}}}",
        f"recording={{path: {path}/capture.bin}}",
        f"recording={{path: capture.bin, settings_path: {path}/radar.yaml}}",
        f"recording={{path: capture.bin, calibration: {path}/calibration.json}}",
    ]


def test_files_of_the_folders_may_be_named_from_the_first_of_them(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    assert parse_scenario(with_radar("radar.yaml"), limits) == reference()
    assert apply_options(reference(), ["radar=radar.yaml"], limits) == reference()
    calibrated = apply_options(reference(), ["radar.calibration=calibration.json"], limits)
    assert calibrated.radar is not None and calibrated.radar.calibration == ideal()


def with_radar(path: str) -> str:
    return f"radar: '{path}'\n{dump(reference(), without=['radar'])}"


@pytest.mark.parametrize("place", ["..", "{outside}", "out", "sub/../..", "./out/../.."])
def test_files_outside_are_refused_unopened_however_they_are_named(
    folder: Path, place: str
) -> None:
    outside, start = folder.parent, reference()
    (folder / "out").symlink_to(outside)
    (folder / "sub").mkdir()
    limits = PageLimits(folders=(folder,))
    OPENED.clear()
    for option in options_naming(place.format(outside=outside)):
        mistake = refused(option, limits, start)
        assert "folders of the studio" in mistake.expected, option
        assert mistake.setting.startswith(option.partition("=")[0].partition(".")[0])
        names = {Path(str(path)).name for path in OPENED}
        assert not names & {"radar.yaml", "calibration.json", "mesh.stl", "capture.bin"}, option


def test_a_link_inside_that_leads_out_is_refused(folder: Path) -> None:
    (folder / "link.yaml").symlink_to(folder.parent / "radar.yaml")
    assert "folders" in refused("radar=link.yaml", PageLimits(folders=(folder,))).expected
    (folder / "circle.yaml").symlink_to("circle.yaml")
    assert refused("radar=circle.yaml", PageLimits(folders=(folder,))).setting == "radar"


def test_a_recording_in_a_folder_whose_files_lead_out_is_refused(folder: Path) -> None:
    (folder / "day").mkdir()
    (folder / "day" / "config.json").symlink_to(folder.parent / "capture.bin")
    (mistake,) = mistakes("recording: {path: day}\n", PageLimits(folders=(folder,)))
    assert mistake.setting == "recording.path" and "folders of the studio" in mistake.expected


def test_a_file_inside_that_names_one_outside_is_refused(folder: Path) -> None:
    text = dump(reference().radar) + "calibration: ../calibration.json\n"
    (folder / "nested.yaml").write_text(text)
    limits = PageLimits(folders=(folder,))
    assert refused("radar=nested.yaml", limits).setting == "calibration"
    named = f"recording={{path: capture.bin, settings_path: {folder}/nested.yaml}}"
    assert refused(named, limits).setting == "calibration"


def test_one_option_cannot_open_the_way_for_the_next(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    both = [f"radar={folder.parent}/radar.yaml", "radar.frame.n_chirps=64"]
    with pytest.raises(DechirpError, match="folders of the studio"):
        apply_options(reference(), both, limits)


@pytest.mark.parametrize("address", ["udp://0.0.0.0:4098", "file:///etc/passwd", "http://a.b/c"])
def test_addresses_are_refused(folder: Path, address: str) -> None:
    text = f"recording: {{path: '{address}'}}\nscene: null\n"
    (mistake,) = mistakes(text, PageLimits(folders=(folder,)))
    assert mistake.setting == "recording.path"
    assert mistake.value == address
    assert (mistake.line, mistake.column) == (1, 19)


@pytest.mark.parametrize("path", ["a\\0b", "a" * 5000, "~/radar.yaml", "/dev/zero", "."])
def test_names_that_are_no_file_are_refused_with_words(folder: Path, path: str) -> None:
    assert refused(f'radar="{path}"', PageLimits(folders=(folder,))).fix


def test_without_folders_no_file_may_be_named(tmp_path: Path) -> None:
    file = tmp_path / "radar.yaml"
    file.write_text(dump(reference().radar))
    assert "none was given" in refused(f"radar={file}").expected


def test_a_recording_of_the_folder_runs_from_the_text_wherever_that_lies(folder: Path) -> None:
    limits = PageLimits(folders=(folder,))
    made = parse_scenario("recording: {path: capture.bin}\n", limits)
    elsewhere = folder.parent / "saved.yaml"
    elsewhere.write_text(dump(made))
    assert load(elsewhere) == made
