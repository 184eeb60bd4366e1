"""What the folders of the studio give away: their own files, by their content, and no others."""

import os

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import reference
from dechirp.studio import library
from dechirp.studio.folders import MAX_DEPTH, is_allowed
from dechirp.studio.frame_sources import open_frame_source
from dechirp.studio.library import FolderScan, LibraryItem, inspect_item, open_item
from dechirp.studio.option_hints import adapt_fix_to_page
from dechirp.studio.scenario_edits import PageLimits, apply_options, parse_scenario
from trial_cases import make_target, small_radar


@pytest.fixture
def folder(tmp_path):
    """A folder of the studio, with a secret beside it."""
    inside = tmp_path / "captures"
    inside.mkdir()
    capture(tmp_path / "secret.npz")
    return inside


def capture(path):
    """Two frames of the small radar, with its settings in them."""
    cube = dc.simulate(dc.Scene(targets=[make_target()]), small_radar(), n_frames=2, seed=1)
    dc.write(dc.recording_from_cube(cube, small_radar()), path)
    return path


def looked(*folders) -> dict[str, str]:
    """Kinds by name, after all was looked through a file at a time."""
    found = FolderScan(PageLimits(folders=folders))
    while not found.is_done:
        found.scan_for(0.0)
    return {item.name: item.kind for item in found.items}


def item_of(path, kind="recording") -> LibraryItem:
    return LibraryItem(kind, path.name, path)


def test_files_are_told_by_their_content(folder):
    capture(folder / "walk.npz")
    (folder / "scene.yaml").write_text(dump(reference()))
    (folder / "notes.md").write_text("# Walk\n")
    (folder / "deeper").mkdir()
    capture(folder / "deeper" / "run.npz")
    (folder / "deeper" / "radar.yaml").write_text(dump(small_radar()))
    assert looked(folder) == {
        "deeper/radar.yaml": "settings",
        "deeper/run.npz": "recording",
        "scene.yaml": "scenario",
        "walk.npz": "recording",
    }


def test_names_start_at_the_folder_and_tell_several_folders_apart(folder, tmp_path):
    other = tmp_path / "more"
    other.mkdir()
    capture(folder / "walk.npz")
    capture(other / "walk.npz")
    assert list(looked(folder, other)) == ["captures/walk.npz", "more/walk.npz"]


def test_hidden_files_and_links_that_lead_out_are_not_shown(folder, tmp_path):
    capture(folder / ".hidden.npz")
    (folder / "out.npz").symlink_to(tmp_path / "secret.npz")
    (folder / "up").symlink_to(tmp_path)
    (folder / "round").symlink_to(folder)
    (folder / "lost.npz").symlink_to(tmp_path / "nowhere.npz")
    capture(folder / "walk.npz")
    (folder / "again.npz").symlink_to(folder / "walk.npz")
    assert looked(folder) == {"again.npz": "recording"}


def test_what_lies_elsewhere_is_refused_however_it_is_named(folder, tmp_path):
    inside, secret = capture(folder / "walk.npz"), tmp_path / "secret.npz"
    (folder / "link.npz").symlink_to(secret)
    limits = PageLimits(folders=(folder,))
    ways = [secret, folder / ".." / "secret.npz", folder / "link.npz", folder / "captures.npz"]
    assert is_allowed(inside, [folder])
    for way in ways:
        assert not is_allowed(way, [folder])
        assert inspect_item(item_of(way), None, limits).n_frames is None
        with pytest.raises(DechirpError, match="outside the folders"):
            open_item(reference(), item_of(way), None, limits)
        with pytest.raises(DechirpError, match="outside the folders"):
            open_item(reference(), item_of(inside), item_of(way, "settings"), limits)


def test_a_pipe_is_never_opened(folder):
    os.mkfifo(folder / "pipe.npz")  # to open it would wait for a writer, for ever
    (folder / "RadarIfxAvian_00").mkdir()
    os.mkfifo(folder / "RadarIfxAvian_00" / "radar.npy")
    (folder / "RadarIfxAvian_00" / "config.json").write_text("{}")
    assert looked(folder) == {}
    with pytest.raises(DechirpError, match="outside the folders"):
        open_item(reference(), item_of(folder / "pipe.npz"), None, PageLimits(folders=(folder,)))


def test_a_folder_whose_files_lead_out_is_no_recording(folder, tmp_path):
    (folder / "day").mkdir()
    (folder / "day" / "radar.npy").symlink_to(tmp_path / "secret.npz")
    assert not is_allowed(folder / "day", [folder])


def test_ten_thousand_files_cost_a_look_at_five_hundred(folder, monkeypatch):
    asked = []
    monkeypatch.setattr(library, "recognise_formats", lambda path: asked.append(path) or ("npy",))
    for number in range(10_000):
        (folder / f"{number:05}.bin").touch()
    found = FolderScan(PageLimits(folders=(folder,)))
    found.scan_for(60.0)
    assert found.is_done and found.n_scanned == len(asked) == library.MAX_SCANNED
    assert found.items[-1].name == "00499.bin"


def test_folders_are_looked_into_to_a_depth(folder):
    names = [f"{depth}" for depth in range(1, MAX_DEPTH + 2)]
    deep = folder.joinpath(*names)
    deep.mkdir(parents=True)
    capture(deep.parent / "near.npz")
    capture(deep / "far.npz")
    near = "/".join(names[:-1])
    assert looked(folder) == {f"{near}/near.npz": "recording"}


def test_the_first_frames_are_looked_over(folder):
    found = inspect_item(item_of(capture(folder / "walk.npz")), None, PageLimits(folders=(folder,)))
    assert (found.n_frames, found.n_inspected) == (2, 2)


def test_a_damaged_recording_is_told_and_not_raised(folder):
    whole = capture(folder / "walk.npz")
    whole.write_bytes(whole.read_bytes()[:5000])
    found = inspect_item(item_of(whole), None, PageLimits(folders=(folder,)))
    assert found.n_frames is None
    (finding,) = found.findings
    assert finding.level == "error" and str(folder) not in str(finding)


def bare(path):
    """Samples without a word on the radar that made them."""
    np.zeros((2, 16, 1, 64), np.complex64).tofile(path)
    return path


def test_a_recording_without_its_radar_asks_for_what_the_page_offers(folder):
    limits = PageLimits(folders=(folder,))
    item = item_of(bare(folder / "bare.bin"))
    (finding,) = inspect_item(item, None, limits).findings
    with pytest.raises(DechirpError) as refused:
        open_item(reference(), item, None, limits)
    alone = parse_scenario(f"recording: {{path: {item.path}}}", limits)
    with pytest.raises(DechirpError) as unseen:
        open_frame_source(alone, limits)
    for one in (finding, *refused.value.mistakes, *unseen.value.mistakes):
        assert one.fix.startswith("choose settings of its radar, under Recordings")
        assert "--" not in one.fix and "Python" not in one.fix


@pytest.mark.parametrize(
    ("fix", "said"),
    [
        ("Read it with --iq qi.", "Read it with recording.iq: qi (under File)."),
        (
            "Name what it is with --format (format=...).",
            "Name what it is with recording.format (under File).",
        ),
        ("Copy it again -- from its source.", "Copy it again -- from its source."),
    ],
)
def test_options_that_no_panel_has_are_settings_of_the_file(fix, said):
    assert adapt_fix_to_page(fix) == said


def test_a_frame_that_is_more_than_a_page_may_ask_for_is_refused_before_it_is_read(folder):
    whole = capture(folder / "walk.npz")
    limits = PageLimits(folders=(folder,), max_samples=2047)
    (finding,) = inspect_item(item_of(whole), None, limits).findings
    assert "2,048 samples" in finding.value and "2,047" in finding.expected


def test_a_recording_is_opened_with_the_chain_that_was_set(folder):
    limits = PageLimits(folders=(folder,))
    scene = apply_options(reference(), ["chain.cfar.false_alarm_probability=1e-4"], limits)
    one = open_item(scene, item_of(capture(folder / "walk.npz")), None, limits)
    assert one.recording.path == str(folder / "walk.npz") and one.scene is None
    assert one.chain == scene.chain


def test_of_a_recording_that_tells_no_azimuth_no_tracks_are_asked_for(folder):
    limits = PageLimits(folders=(folder,))
    scene = apply_options(reference(), ["radar.array.rx=[[0, 0, 0], [0, 1.9 mm, 0]]"], limits)
    scene = apply_options(scene, ["tracker={}", "n_frames=10"], limits)
    one = open_item(scene, item_of(capture(folder / "walk.npz")), None, limits)
    assert scene.tracker is not None and one.tracker is None


def test_a_scenario_finds_the_files_that_it_names_beside_it(folder):
    deeper = folder / "deeper"
    deeper.mkdir()
    capture(deeper / "walk.npz")
    (deeper / "play.yaml").write_text("recording: {path: walk.npz}\n")
    limits = PageLimits(folders=(folder,))
    found = open_item(reference(), item_of(deeper / "play.yaml", "scenario"), None, limits)
    assert found.recording.path == str(deeper / "walk.npz")


def test_a_scenario_that_names_a_file_outside_is_refused(folder):
    (folder / "play.yaml").write_text("recording: {path: ../secret.npz}\n")
    with pytest.raises(DechirpError, match="a file in the folders of the studio"):
        open_item(
            reference(),
            item_of(folder / "play.yaml", "scenario"),
            None,
            PageLimits(folders=(folder,)),
        )
