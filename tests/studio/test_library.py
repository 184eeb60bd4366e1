"""Library of the studio: classification, inspection and access limits of files in its folders."""

import os
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import RecordingSource, reference
from dechirp.processing.chain import Chain
from dechirp.studio import library
from dechirp.studio.folders import MAX_DEPTH, is_tree_inside
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.frame_sources import open_frame_source
from dechirp.studio.library import (
    FolderScan,
    LibraryItem,
    inspect_first_frames,
    open_item_as_scenario,
)
from dechirp.studio.option_hints import translate_cli_fix_to_page
from dechirp.studio.scenario_edits import PageLimits, apply_overrides, parse_scenario
from nightly import nightly
from trial_cases import make_target, small_radar


@pytest.fixture
def folder(tmp_path):
    """Create a folder of the studio, with a secret file outside it."""
    captures = tmp_path / "captures"
    captures.mkdir()
    write_recording(tmp_path / "secret.npz")
    return captures


def write_recording(path):
    """Write two frames of the small radar, with its settings."""
    cube = dc.simulate(dc.Scene(targets=[make_target()]), small_radar(), n_frames=2, seed=1)
    dc.write(dc.recording_from_cube(cube, small_radar()), path)
    return path


def scan_kinds(*folders) -> dict[str, str]:
    """Scan folders one file at a time; return kinds by item name."""
    scan = FolderScan(PageLimits(folders=folders))
    while not scan.is_done:
        scan.scan_for(0.0)
    return {item.name: item.kind for item in scan.items}


def make_item(path, kind="recording") -> LibraryItem:
    return LibraryItem(kind, path.name, path)


def test_files_are_classified_by_content(folder):
    write_recording(folder / "walk.npz")
    (folder / "scene.yaml").write_text(dump_yaml(reference()))
    (folder / "notes.md").write_text("# Walk\n")
    (folder / "deeper").mkdir()
    write_recording(folder / "deeper" / "run.npz")
    (folder / "deeper" / "radar.yaml").write_text(dump_yaml(small_radar()))
    assert scan_kinds(folder) == {
        "deeper/radar.yaml": "settings",
        "deeper/run.npz": "recording",
        "scene.yaml": "scenario",
        "walk.npz": "recording",
    }


def test_item_names_are_relative_and_distinguish_folders(folder, tmp_path):
    second_folder = tmp_path / "more"
    second_folder.mkdir()
    write_recording(folder / "walk.npz")
    write_recording(second_folder / "walk.npz")
    assert list(scan_kinds(folder, second_folder)) == ["captures/walk.npz", "more/walk.npz"]


def test_hidden_files_and_links_to_outside_are_not_listed(folder, tmp_path):
    write_recording(folder / ".hidden.npz")
    (folder / "out.npz").symlink_to(tmp_path / "secret.npz")
    (folder / "up").symlink_to(tmp_path)
    (folder / "round").symlink_to(folder)
    (folder / "lost.npz").symlink_to(tmp_path / "nowhere.npz")
    write_recording(folder / "walk.npz")
    (folder / "again.npz").symlink_to(folder / "walk.npz")
    assert scan_kinds(folder) == {"again.npz": "recording"}


def test_rejects_outside_paths_in_any_form(folder, tmp_path):
    recording, secret = write_recording(folder / "walk.npz"), tmp_path / "secret.npz"
    (folder / "link.npz").symlink_to(secret)
    limits = PageLimits(folders=(folder,))
    outside_paths = [
        secret,
        folder / ".." / "secret.npz",
        folder / "link.npz",
        folder / "captures.npz",
    ]
    assert is_tree_inside(recording, [folder])
    for path in outside_paths:
        assert not is_tree_inside(path, [folder])
        assert inspect_first_frames(make_item(path), None, limits).n_frames is None
        with pytest.raises(DechirpError, match="outside the folders"):
            open_item_as_scenario(reference(), make_item(path), None, limits)
        with pytest.raises(DechirpError, match="outside the folders"):
            open_item_as_scenario(
                reference(), make_item(recording), make_item(path, "settings"), limits
            )


def test_pipe_is_never_opened(folder):
    os.mkfifo(folder / "pipe.npz")  # opening it would block until a writer appears
    (folder / "RadarIfxAvian_00").mkdir()
    os.mkfifo(folder / "RadarIfxAvian_00" / "radar.npy")
    (folder / "RadarIfxAvian_00" / "config.json").write_text("{}")
    assert scan_kinds(folder) == {}
    with pytest.raises(DechirpError, match="outside the folders"):
        open_item_as_scenario(
            reference(), make_item(folder / "pipe.npz"), None, PageLimits(folders=(folder,))
        )


def test_folder_with_links_to_outside_is_not_allowed(folder, tmp_path):
    (folder / "day").mkdir()
    (folder / "day" / "radar.npy").symlink_to(tmp_path / "secret.npz")
    assert not is_tree_inside(folder / "day", [folder])


@nightly
def test_scan_of_ten_thousand_files_inspects_five_hundred(folder, monkeypatch):
    inspected_paths = []
    monkeypatch.setattr(
        library, "recognise_formats", lambda path: inspected_paths.append(path) or ("npy",)
    )
    for number in range(10_000):
        (folder / f"{number:05}.bin").touch()
    scan = FolderScan(PageLimits(folders=(folder,)))
    scan.scan_for(60.0)
    assert scan.is_done and scan.n_scanned == len(inspected_paths) == library.MAX_SCANNED
    assert scan.items[-1].name == "00499.bin"


def test_scan_stops_at_maximum_depth(folder):
    names = [f"{depth}" for depth in range(1, MAX_DEPTH + 2)]
    deep = folder.joinpath(*names)
    deep.mkdir(parents=True)
    write_recording(deep.parent / "near.npz")
    write_recording(deep / "far.npz")
    near = "/".join(names[:-1])
    assert scan_kinds(folder) == {f"{near}/near.npz": "recording"}


def test_inspection_reads_first_frames(folder):
    inspection = inspect_first_frames(
        make_item(write_recording(folder / "walk.npz")), None, PageLimits(folders=(folder,))
    )
    assert (inspection.n_frames, inspection.n_inspected) == (2, 2)


def test_damaged_recording_gives_error_finding(folder):
    recording = write_recording(folder / "walk.npz")
    recording.write_bytes(recording.read_bytes()[:5000])
    inspection = inspect_first_frames(make_item(recording), None, PageLimits(folders=(folder,)))
    assert inspection.n_frames is None
    (finding,) = inspection.findings
    assert finding.level == "error" and str(folder) not in str(finding)


def write_raw_samples(path):
    """Write samples without radar settings."""
    np.zeros((2, 16, 1, 64), np.complex64).tofile(path)
    return path


def test_missing_radar_settings_give_fix_for_page(folder):
    limits = PageLimits(folders=(folder,))
    item = make_item(write_raw_samples(folder / "bare.bin"))
    (finding,) = inspect_first_frames(item, None, limits).findings
    with pytest.raises(DechirpError) as open_error:
        open_item_as_scenario(reference(), item, None, limits)
    scenario = parse_scenario(f"recording: {{path: {item.path}}}", limits)
    with pytest.raises(DechirpError) as source_error:
        open_frame_source(scenario, limits)
    for mistake in (finding, *open_error.value.mistakes, *source_error.value.mistakes):
        assert mistake.fix.startswith("choose settings of its radar, under Recordings")
        assert "--" not in mistake.fix and "Python" not in mistake.fix


@pytest.mark.parametrize(
    ("fix", "expected"),
    [
        ("Read it with --iq qi.", "Read it with recording.iq: qi (under File)."),
        (
            "Name what it is with --format (format=...).",
            "Name what it is with recording.format (under File).",
        ),
        ("Copy it again -- from its source.", "Copy it again -- from its source."),
        (
            "Run with --calibration cal.json",
            "Run with recording.calibration: cal.json (under File)",
        ),
        (
            'measure it by "dechirp calibrate REFLECTOR", and run with --calibration cal.json',
            'measure it by "dechirp calibrate REFLECTOR", and set recording.calibration: cal.json'
            " (under File)",
        ),
        (
            "give the one of this recording (radar=... in Python), or name it like the recording:"
            " --radar angles/radar_1GHz.cfg, --radar 'full band.cfg'",
            "choose the one of this recording as settings of its radar, under Recordings, or name"
            " it like the recording: angles/radar_1GHz.cfg, full band.cfg",
        ),
        (
            "give its settings: --radar FILE (radar=FILE in Python)",
            "choose settings of its radar, under Recordings",
        ),
        (
            "give the radar as a YAML file (--radar FILE) if they were others",
            "give the radar as a YAML file (settings of its radar, under Recordings) if they were"
            " others",
        ),
        ("Select with --frames, or wait.", "Select with recording.frames (under File), or wait."),
        (
            "--set recording.repair_faults=false keeps them",
            "recording.repair_faults=false (under File) keeps them",
        ),
    ],
)
def test_command_line_options_in_fixes_become_settings(fix, expected):
    assert translate_cli_fix_to_page(fix) == expected


def test_frame_above_page_limit_is_reported_before_reading(folder):
    recording = write_recording(folder / "walk.npz")
    limits = PageLimits(folders=(folder,), max_samples=2047)
    (finding,) = inspect_first_frames(make_item(recording), None, limits).findings
    assert "2,048 samples" in finding.value and "2,047" in finding.expected


def test_recording_opened_from_scene_is_processed_as_by_run(folder):
    limits = PageLimits(folders=(folder,))
    options = ["chain.cfar.false_alarm_probability=1e-4", "chain.cluster={}"]
    scenario = apply_overrides(reference(), options, limits)
    item = make_item(write_recording(folder / "walk.npz"))
    opened = open_item_as_scenario(scenario, item, None, limits)
    assert opened.recording.path == str(folder / "walk.npz") and opened.scene is None
    assert opened.chain == Chain(cluster=scenario.chain.cluster)  # clusters change no detection
    changed = apply_overrides(opened, options[:1], limits)
    assert open_item_as_scenario(changed, item, None, limits).chain == changed.chain


def test_training_cells_of_opened_recording_fit_its_map(folder):
    limits = PageLimits(folders=(folder,))
    frame = small_radar().frame
    options = [f"chain.cfar.n_training={{range: 6, velocity: {frame.n_chirps}}}"]
    item = make_item(write_recording(folder / "walk.npz"))
    longer = apply_overrides(reference(), options, limits)
    scenario = replace(longer, scene=None, recording=RecordingSource(path=str(item.path)))
    opened = open_item_as_scenario(scenario, item, None, limits)
    assert opened.chain.cfar.n_training == Chain().cfar.n_training
    assert FramePlayer(opened, limits).process_frame_at_step(0, None).power.size


def test_tracker_is_removed_for_array_without_azimuth(folder):
    limits = PageLimits(folders=(folder,))
    scenario = apply_overrides(reference(), ["radar.array.rx=[[0, 0, 0], [0, 1.9 mm, 0]]"], limits)
    scenario = apply_overrides(scenario, ["tracker={}", "n_frames=10"], limits)
    recording_scenario = open_item_as_scenario(
        scenario, make_item(write_recording(folder / "walk.npz")), None, limits
    )
    assert scenario.tracker is not None and recording_scenario.tracker is None


def test_scenario_resolves_paths_relative_to_its_file(folder):
    deeper = folder / "deeper"
    deeper.mkdir()
    write_recording(deeper / "walk.npz")
    (deeper / "play.yaml").write_text("recording: {path: walk.npz}\n")
    limits = PageLimits(folders=(folder,))
    scenario = open_item_as_scenario(
        reference(), make_item(deeper / "play.yaml", "scenario"), None, limits
    )
    assert scenario.recording.path == str(deeper / "walk.npz")


def test_rejects_scenario_naming_file_outside(folder):
    (folder / "play.yaml").write_text("recording: {path: ../secret.npz}\n")
    with pytest.raises(DechirpError, match="a file in the folders of the studio"):
        open_item_as_scenario(
            reference(),
            make_item(folder / "play.yaml", "scenario"),
            None,
            PageLimits(folders=(folder,)),
        )
