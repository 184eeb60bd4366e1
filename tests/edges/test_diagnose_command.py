"""`dechirp diagnose`: arrays in files of NumPy and MATLAB."""

import json
import re
import shlex
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from foreign_arrays import (
    random_map,
    random_radar,
    right_fast_samples,
    swapped_samples,
    threshold_parts,
)
from formats.native_recordings import make_complex_code_recording

CORPUS = Path(__file__).parents[1] / "bad_input" / "corpus" / "recording"


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run_command(*arguments):
        with pytest.raises(SystemExit) as caught:
            main(["diagnose", *map(str, arguments)])
        printed = capsys.readouterr()
        return caught.value.code, printed.out, printed.err

    return run_command


def save_mat73(file, arrays):
    """Save arrays as MATLAB's version 7.3 does: HDF5 with reversed axes, after 512 bytes."""
    with h5py.File(file, "w", userblock_size=512) as content:
        for name, array in arrays.items():
            content[name] = np.atleast_2d(array).T
            content[name].attrs["MATLAB_class"] = np.bytes_("double")
        refs = content.create_group("#refs#")
        refs["a"] = np.zeros(3)
    with Path(file).open("r+b") as content:
        content.write(b"MATLAB 7.3 MAT-file".ljust(128))


def test_map_of_amplitudes_is_found_in_npz_and_mat(call):
    rng = np.random.default_rng(1)
    _, _, made = random_map(rng, radar=random_radar(rng, n_samples=256), padding=(1, 1))
    # The sign of velocities cannot be told from powers.
    for scale, expected, n_findings in (("power", 1, 1), ("amplitude", 3, 0)):
        arrays = {
            "map": np.sqrt(made.power),
            "range_m": made.range_m,
            "velocity_m_per_s": made.velocity_m_per_s,
        }
        np.savez("map.npz", **arrays)
        scipy.io.savemat("map.mat", arrays)
        save_mat73("map73.mat", arrays)
        for file in ("map.npz", "map.mat", "map73.mat"):
            status, out, _ = call(file, "--scale", scale, "--summed", made.n_channels, "--json")
            assert status == expected
            document = json.loads(out)
            assert [finding["setting"] for finding in document["findings"]] == [
                "scale"
            ] * n_findings
            assert document["undetermined"]


def test_swapped_samples_are_found_in_npy(call, tmp_path):
    case = swapped_samples(np.random.default_rng(3))
    samples, radar = case.arguments
    np.save("beat.npy", samples)
    (tmp_path / "radar.yaml").write_text(dump_yaml(radar))
    status, out, _ = call("beat.npy", "--radar", "radar.yaml")
    assert status == 1
    assert "warning: iq:" in out
    status, _, error = call("beat.npy")
    assert status == 2
    assert "samples without radar" in error


def test_status_is_0_only_if_every_mistake_could_be_told(call, tmp_path):
    case = right_fast_samples(np.random.default_rng(3))
    samples, radar = case.arguments
    np.save("beat.npy", samples)
    (tmp_path / "radar.yaml").write_text(dump_yaml(radar))
    status, out, _ = call("beat.npy", "--radar", "radar.yaml")
    assert status == 0
    assert "No known mistake was found." in out
    noise = np.random.default_rng(1).permutation(samples.ravel()).reshape(samples.shape)
    np.save("noise.npy", noise)
    status, out, _ = call("noise.npy", "--radar", "radar.yaml")
    assert status == 3
    assert re.search(r"No known mistake was found, but \d could not be told\.", out)


def test_threshold_of_a_map(call):
    (power, n_training, n_guard), pfa, mean, n = threshold_parts(np.random.default_rng(8))
    arrays = {
        "power": power,
        "range_m": np.arange(power.shape[1]),
        "velocity_m_per_s": np.arange(power.shape[0]) - power.shape[0] // 2,
        "threshold": n * n * (pfa ** (-1 / n) - 1) * mean,
    }
    np.savez("map.npz", **arrays)
    cells = [",".join(map(str, pair)) for pair in (n_training, n_guard)]
    options = ("--training", cells[0], "--guard", cells[1], "--pfa", pfa)
    status, out, _ = call("map.npz", *options)
    assert status == 1
    assert "divide by their number" in " ".join(out.split())
    status, _, error = call("map.npz")
    assert status == 2
    assert "threshold without n_training" in error
    arrays["threshold"][9, 64] = np.nan  # far from the ends of the map
    np.savez("map.npz", **arrays)
    status, _, error = call("map.npz", *options)
    assert status == 2
    assert "threshold: NaN in 1 cells" in error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--pfa", "3"), "pfa: 3"),
        (("--pfa", "1e-4"), "pfa: 0.0001; expected an array threshold"),
        (("--training", "2,8"), "n_training: (2, 8); expected an array threshold"),
        (("--guard", "1"), "n_guard: 1; expected an array threshold"),
    ],
)
def test_options_of_a_threshold_without_one_are_refused(call, options, message):
    power = np.random.default_rng(1).exponential(1.0, 64)
    np.savez("profile.npz", power=power, range_m=np.arange(64.0))
    status, out, error = call("profile.npz", *options)
    assert status == 2
    assert out == ""
    assert message in " ".join(error.split())


@pytest.mark.parametrize("content", [b"", b"no arrays", b"PK\x03\x04 damaged", b"\x93NUMPY\x01"])
def test_damaged_files_end_in_one_error(call, tmp_path, content):
    (tmp_path / "x.npz").write_bytes(content)
    status, out, error = call("x.npz")
    assert status == 2
    assert out == ""
    assert len(error.splitlines()) == error.count("; expected ") == 1


def test_missing_files_and_unknown_arrays_are_refused(call):
    assert "not readable" in call("nothing.npz")[2]
    np.savez("two.npz", a=np.ones(20), b=np.ones(20), range_m=np.arange(20))
    status, _, error = call("two.npz")
    assert status == 2
    assert "arrays a, b, range_m" in error
    np.savez("one.npz", a=np.ones(20), range_m=np.arange(20))
    for options in (("--training", "2,x"), ("--target-range", "20"), ("--scale", "dB")):
        status, _, error = call("one.npz", *options)
        assert status == 2
        assert len(error.splitlines()) == error.count("; expected ") == 1


@pytest.mark.parametrize("name", ["x.sigmf-meta", "x.bin", "x y.wav"])
def test_recordings_are_pointed_to_inspect(call, tmp_path, name):
    recording = make_complex_code_recording()
    if name.endswith(".wav"):
        (tmp_path / name).write_bytes((CORPUS / "sync-wav.wav").read_bytes())
    else:
        dc.write(recording, tmp_path / name)
    status, out, error = call(name)
    assert (status, out) == (2, "")
    assert f"dechirp inspect {shlex.quote(name)};" in error
    # The frame that the message asks for can be diagnosed.
    np.save("frame.npy", recording.cube[0].transpose("rx", "chirp", "sample"))
    (tmp_path / "radar.yaml").write_text(dump_yaml(recording.radar))
    assert "frame.npy" in call("frame.npy", "--radar", "radar.yaml")[1]


def test_files_that_are_no_recordings_are_not_pointed_to_inspect(call, tmp_path):
    (tmp_path / "x.txt").write_text("no arrays")
    error = call("x.txt")[2]
    assert "save it with numpy.savez" in error
    assert "inspect" not in error


@pytest.mark.parametrize("name", ["map.csv", "map.txt", "map.h5"])
def test_maps_in_other_containers_are_saved_with_numpy(call, name):
    """Text and HDF5 contain maps as often as recordings, and `inspect` describes samples only."""
    power = np.random.default_rng(0).exponential(size=(64, 128))
    if name.endswith(".h5"):
        with h5py.File(name, "w") as file:
            file["power"], file["range_m"] = power, np.arange(128.0)
            file["velocity_m_per_s"] = np.arange(64.0)
    else:
        np.savetxt(name, power, delimiter="," if name.endswith(".csv") else " ")
    error = call(name)[2]
    assert "save it with numpy.savez" in error
    assert "inspect" not in error


def test_point_clouds_are_pointed_to_inspect(call):
    error = call(str(CORPUS / "radar-scan.mcap"))[2]
    assert "dechirp inspect" in error
    assert "if it has samples, save one frame" in error


def test_recordings_that_need_an_extra_are_pointed_to_inspect(call, tmp_path, monkeypatch):
    """The extra reads recordings, which are no arrays with it either."""
    (tmp_path / "x.wav").write_bytes((CORPUS / "sync-wav.wav").read_bytes())
    monkeypatch.setitem(sys.modules, "soundfile", None)
    error = call("x.wav")[2]
    assert "dechirp inspect x.wav;" in error
    assert "pip install" not in error
