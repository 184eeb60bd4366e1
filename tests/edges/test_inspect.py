"""`dechirp inspect` and `dechirp.inspect`: a recording looked over, and what is said of it."""

import json
import struct

import numpy as np
import pytest
from matplotlib import image

import dechirp as dc
from dechirp.cli.main import main

RADAR = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 30 us,
          sample_rate: 10 MHz, n_samples: 64, sampling: complex}
  n_chirps: 32
  interval: 40 us
array:
  rx: [[0 mm, 0 mm, 0 mm], [0 mm, 1.9 mm, 0 mm]]
"""


def cube() -> np.ndarray:
    """int16 of three frames of one echo over noise, (frame, chirp, rx, sample, iq)."""
    rng = np.random.default_rng(1)
    beat = 4000 * np.exp(2j * np.pi * 0.13 * np.arange(64))
    noise = 300 * (rng.standard_normal((3, 32, 2, 64)) + 1j * rng.standard_normal((3, 32, 2, 64)))
    both = beat + noise
    return np.stack([both.real, both.imag], axis=-1).round().astype(np.int16)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "radar.yaml").write_text(RADAR)
    np.save("cube.npy", cube())
    return tmp_path


AXES = ("--radar", "radar.yaml", "--axes", "frame,chirp,rx,sample,iq")


def call(capsys, *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["inspect", *words])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def test_a_recording_is_described_and_pictured(folder, capsys):
    status, out, err = call(capsys, "cube.npy", *AXES, "--json")

    document = json.loads(out)
    assert (status, err) == (0, "")
    assert document["format"] == "npy"
    assert document["dims"] == {"frame": 3, "chirp": 32, "rx": 2, "sample": 64}
    assert document["radar"]["frame"]["n_chirps"] == 32
    assert document["radar"]["derived"]["max_range_m"] == pytest.approx(49.965, rel=1e-4)
    assert [finding["level"] for finding in document["findings"]] == []
    assert json.loads((folder / "dechirp-inspect" / "inspect.json").read_text()) == document
    assert image.imread(folder / "dechirp-inspect" / "map.png").shape[1] == 1560


def test_what_is_wrong_is_told_in_words_and_in_the_document(folder, capsys):
    samples = cube()
    samples[:, :, 1] = 0  # a dead receiver
    samples[0, 5, 0, 10:20] = 32767  # clipped
    np.save("broken.npy", samples)

    _, out, _ = call(capsys, "broken.npy", *AXES)
    _, document, _ = call(capsys, "broken.npy", *AXES, "--json")

    warned = [f for f in json.loads(document)["findings"] if f["level"] == "warning"]
    assert any("clip" in f["setting"] for f in warned)
    assert any("receiver 1" in f["value"] for f in warned)
    assert out.count("warning:") == len(warned)


def test_a_known_file_that_cannot_be_read_yet_says_what_is_missing(folder, capsys):
    status, out, _ = call(capsys, "cube.npy", "--radar", "radar.yaml", "--json")

    document = json.loads(out)
    assert status == 0
    assert document["format"] == "npy"
    assert (document["dims"], document["radar"]) == (None, None)
    (missing,) = document["findings"]
    assert missing["level"] == "error"
    assert "--axes" in missing["fix"]
    assert set(document["files"]) == {"inspect.json"}


def test_an_unknown_file_and_one_that_is_not_there_end_with_status_2(folder, capsys):
    (folder / "letter.txt").write_text("Dear reader,\n")

    for name in ("letter.txt", "absent.bin"):
        status, out, _ = call(capsys, name, "--json")

        assert status == 2
        assert set(json.loads(out)) == {"errors"}
    assert not (folder / "dechirp-inspect").exists()


def test_points_of_a_radar_are_seen_from_above(folder, capsys):
    points = struct.pack("<4f", -1.0, 2.0, 0.0, 0.5)
    items = struct.pack("<II", 1, 16) + points
    head = struct.pack("<8I", 0x03060000, 40 + 24, 0xA1843, 7, 0, 1, 1, 0)
    (folder / "stream.dat").write_bytes((bytes.fromhex("0201040306050807") + head + items) * 2)

    status, out, _ = call(capsys, "stream.dat", "--json")

    document = json.loads(out)
    assert (status, document["format"]) == (0, "ti-uart")
    assert document["dims"] == {"frame": 2, "detection": 2}
    assert image.imread(folder / "dechirp-inspect" / "map.png").shape[1] == 1560


def test_rules_that_the_device_breaks_are_findings(folder, capsys):
    _, out, _ = call(capsys, "cube.npy", *AXES, "--device", "xwr1642", "--json")

    broken = [f for f in json.loads(out)["findings"] if f["level"] == "error"]
    # 10 MS/s is above the chip's 6.25 MS/s, and its filter ends at 5 MHz.
    assert "radar.frame.chirp.sample_rate" in [finding["setting"] for finding in broken]


def test_rules_of_frames_count_only_where_the_period_is_known(folder, capsys):
    # Without a period 300 chirps may have come in frames of one; with it they are one frame.
    (folder / "many.yaml").write_text(RADAR.replace("n_chirps: 32", "n_chirps: 300"))
    (folder / "framed.yaml").write_text(
        RADAR.replace("n_chirps: 32", "n_chirps: 300\n  period: 12.1 ms")
    )
    np.save("many.npy", np.concatenate([cube().reshape(1, 96, 2, 64, 2)] * 4, axis=1)[:, :300])

    settings = {}
    for name in ("many", "framed"):
        told = ("--radar", f"{name}.yaml", *AXES[2:], "--device", "xwr1443")
        _, out, _ = call(capsys, "many.npy", *told, "--json")
        broken = [f for f in json.loads(out)["findings"] if f["level"] == "error"]
        settings[name] = {finding["setting"] for finding in broken}

    frames = {"radar.frame.n_chirps", "radar.frame.period"}
    assert settings["framed"] & frames == frames
    assert not settings["many"] & frames


@pytest.mark.parametrize(
    ("told", "named"),
    [
        (("--device", "xwr9999"), "xwr9999"),
        (("--radar", "absent.yaml"), "absent.yaml"),
        (("--radar", "wrong.cfg"), "profileCfg"),
    ],
)
def test_what_is_told_wrongly_is_no_finding_of_the_recording(folder, capsys, told, named):
    (folder / "wrong.cfg").write_text("profileCfg 0 77\n")

    status, _, err = call(capsys, "cube.npy", *AXES[2:], *told)

    assert status == 2
    assert named in err
    assert not (folder / "dechirp-inspect").exists()


def test_a_part_of_the_frames_is_looked_at_when_asked(folder, capsys):
    _, out, _ = call(capsys, "cube.npy", *AXES, "--frames", "1:3", "--json")

    assert json.loads(out)["dims"]["frame"] == 2


def test_python_gives_the_same_as_the_command(folder):
    seen = dc.inspect("cube.npy", radar="radar.yaml", axes="frame,chirp,rx,sample,iq")

    assert seen.formats == ("npy",)
    assert seen.recording is not None
    assert seen.power is not None
    assert seen.power.sizes == {"velocity": 32, "range": 64}
    assert seen.findings == ()


def test_a_folder_of_somebody_else_is_not_replaced(folder, capsys):
    (folder / "mine").mkdir()
    (folder / "mine" / "thesis.txt").write_text("years of work")

    status, _, err = call(capsys, "cube.npy", *AXES, "--out", "mine")

    assert status == 2
    assert "thesis.txt" in err
    assert (folder / "mine" / "thesis.txt").exists()


@pytest.mark.parametrize(
    "words",
    [("--frames", "3:9"), ("--device", "xwr9999"), ("--radar", "absent.yaml")],
)
def test_a_wrong_call_is_no_finding(folder, capsys, words):
    status, out, _ = call(capsys, "cube.npy", *AXES, *words, "--json")

    assert status == 2
    assert set(json.loads(out)) == {"errors"}
    assert not (folder / "dechirp-inspect").exists()


def test_an_option_that_the_format_does_not_take_is_a_wrong_call(folder, capsys):
    (folder / "capture.bin").write_bytes(cube().tobytes())

    status, out, _ = call(capsys, "capture.bin", *AXES, "--json")

    assert status == 2
    assert "with axes given" in json.loads(out)["errors"][0]["value"]


def test_a_settings_file_is_told_from_a_recording(folder, capsys):
    status, out, _ = call(capsys, "radar.yaml", "--json")

    (error,) = json.loads(out)["errors"]
    assert status == 2
    assert error["value"] == "the settings of a recording, not its samples"
    assert "--radar" in error["fix"]
