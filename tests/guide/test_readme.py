"""Python blocks of the README, run as they are shown."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from markdown_it import MarkdownIt

import dechirp as dc
from nightly import nightly

README = Path(__file__).parents[2] / "README.md"
BLOCKS = [
    token.content
    for token in MarkdownIt().parse(README.read_text(encoding="utf-8"))
    if token.info == "python"
]


def run_block(first_words, capsys):
    """Run the block that contains some words; return its names and its output."""
    (block,) = [block for block in BLOCKS if first_words in block]
    names = {}
    exec(compile(block, str(README), "exec"), names)
    return names, capsys.readouterr().out


def test_every_block_is_run_by_a_test():
    assert len(BLOCKS) == 2


def test_block_of_radar_prints_range_and_velocity(capsys):
    names, output = run_block("dc.design", capsys)
    truth = dc.truth(dc.Scene(targets=[names["target"]]), names["radar"])
    range_m, velocity_m_per_s = (float(word.strip("[]")) for word in output.split())
    detections = names["detections"]
    for name, printed in (("range", range_m), ("velocity", velocity_m_per_s)):
        assert printed == pytest.approx(detections[name].item())
        error = printed - truth[name].item()
        assert abs(error) < 5 * detections[f"{name}_std"].item()


def test_block_of_arrays_prints_no_directions_of_frame_without_detections(
    tmp_path, monkeypatch, capsys
):
    rng = np.random.default_rng(2)
    monkeypatch.chdir(tmp_path)
    np.save("samples.npy", rng.standard_normal((8, 64, 128, 2)) @ [1, 1j])

    names, output = run_block("samples.npy", capsys)

    assert names["directions"].azimuth_rad.shape == (0, 1)
    assert output == "[]\n"


@pytest.mark.parametrize("is_complex", [True, False])
def test_block_of_arrays_prints_directions(is_complex, tmp_path, monkeypatch, capsys):
    """Samples of another program: two echoes in int16 codes or complex numbers."""
    rng, chirp, sample = np.random.default_rng(1), np.arange(64)[:, None], np.arange(128)
    samples = 40 * (rng.standard_normal((8, 64, 128)) + 1j * rng.standard_normal((8, 64, 128)))
    for azimuth_deg, doppler, beat in ((-20, 0.15, 0.3), (12, -0.2, 0.1)):
        steering = np.exp(-1j * np.pi * np.arange(8) * np.sin(np.radians(azimuth_deg)))
        echo = 60 * np.exp(2j * np.pi * (doppler * chirp + beat * sample))
        samples += steering[:, None, None] * echo
    monkeypatch.chdir(tmp_path)
    np.save("samples.npy", samples if is_complex else samples.real.round().astype(np.int16))

    names, output = run_block("samples.npy", capsys)

    azimuth_deg = np.degrees(names["directions"].azimuth_rad[:, 0])
    assert output.count("[") == 1 + len(azimuth_deg) == 3
    # The Cramer-Rao bound is 0.2 degrees at an SNR of 20 dB in each receiver.
    assert np.max(abs(np.sort(azimuth_deg) - [-20, 12])) < 1


@nightly
def test_blocks_compile_nothing_in_a_new_installation(tmp_path, monkeypatch):
    """Compiling what they need takes 50 s of processor time."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    rng = np.random.default_rng(1)
    tone = np.exp(0.6j * np.pi * np.arange(128)) * np.ones((8, 64, 1))
    noise = rng.standard_normal((8, 64, 128)) + 1j * rng.standard_normal((8, 64, 128))
    np.save(tmp_path / "samples.npy", tone + noise)
    script = "\n".join([*BLOCKS, 'import sys; print("numba" in sys.modules)'])

    process = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )

    assert process.stdout.splitlines()[-1] == "False"
