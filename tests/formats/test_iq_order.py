"""Order of I and Q: guessed from the echoes, not from the coupling between the antennas."""

import json

import numpy as np
import pytest

from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.samples.iq_order import guess_iq_order

pytestmark = pytest.mark.usefixtures("without_figures")


pytestmark = pytest.mark.usefixtures("without_figures")


N_SAMPLES = 64


def make_radar(n_chirps: int, n_tx: int = 1) -> Radar:
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=30e12,
        ramp_duration_s=14e-6,
        sample_rate_hz=5e6,
        n_samples=N_SAMPLES,
        sampling="complex",
    )
    tdm = {"multiplexing": Tdm(order=tuple(range(n_tx)))} if n_tx > 1 else {}
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=n_chirps, interval_s=20e-6, **tdm),
        array=Array(tx_m=tuple((0.0, 4e-3 * n, 0.0) for n in range(n_tx))),
    )


def tone(n_chirps: int, *, beat_bin: float, amplitude: float, cycles: float = 0.0) -> np.ndarray:
    """Return an echo (chirp, rx, sample) whose phase turns by `cycles` from first to last chirp."""
    phase = beat_bin / N_SAMPLES * np.arange(N_SAMPLES)
    phase = phase + np.linspace(0, cycles, n_chirps)[:, None, None]
    return amplitude * np.exp(2j * np.pi * phase)


def noise(n_chirps: int, amplitude: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    parts = rng.standard_normal((2, n_chirps, 1, N_SAMPLES)) * amplitude / np.sqrt(2)
    return parts[0] + 1j * parts[1]


def write_capture(path, samples: np.ndarray) -> None:
    """Write samples (chirp, 1, sample) in pairs, I I Q Q, as a DCA1000 with two lanes does.

    Each of the four receivers of the board gets the same samples.
    """
    samples = samples.repeat(4, axis=1)
    codes = np.stack([samples.real, samples.imag], axis=-1).round().astype("<i2")
    path.write_bytes(codes.reshape(len(samples), -1, 2, 2).swapaxes(-1, -2).tobytes())


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("frame_chirps", [64, 1])
def test_moving_echo_outweighs_stronger_coupling(tmp_path, swapped, frame_chirps):
    # The coupling is 40 dB stronger and mostly on the other side of zero.
    samples = (
        tone(64, beat_bin=-1.4, amplitude=3000)
        + tone(64, beat_bin=8.5, amplitude=30, cycles=3)
        + noise(64, 10)
    )
    write_capture(tmp_path / "capture.bin", 1j * samples.conj() if swapped else samples)

    recording = open_recording(
        tmp_path / "capture.bin", radar=make_radar(frame_chirps), device="xwr1642"
    )

    assert recording.contents.iq == ("qi" if swapped else "iq")
    assert [f.level for f in recording.findings if f.setting == "iq"] == ["note"]


def test_static_echo_decides_where_nothing_moves():
    samples = tone(1, beat_bin=-1.4, amplitude=3000) + tone(1, beat_bin=20.3, amplitude=300)

    iq, finding = guess_iq_order(samples + noise(1, 10))

    assert (iq, finding.level) == ("iq", "note")


def test_means_of_transmitters_are_removed_separately():
    # Coupling of two transmitters in turn: a common mean would leave half their difference.
    coupling = tone(64, beat_bin=-4.6, amplitude=3000)
    coupling[1::2] *= -0.5
    samples = coupling + tone(64, beat_bin=12, amplitude=60, cycles=2) + noise(64, 10)

    iq, finding = guess_iq_order(samples, n_slots=2)

    assert (iq, finding.level) == ("iq", "note")


def test_run_warns_about_undecided_order(tmp_path, capsys):
    write_capture(tmp_path / "capture.bin", noise(64, 100))
    (tmp_path / "radar.yaml").write_text(dump_yaml(make_radar(64)))

    with pytest.raises(SystemExit) as exit_info:
        main(["run", str(tmp_path / "capture.bin"), "--radar", str(tmp_path / "radar.yaml"),
              "--device", "xwr1642", "--out", str(tmp_path / "out"), "--json"])  # fmt: skip

    findings = json.loads(capsys.readouterr().out)["findings"]
    (finding,) = [finding for finding in findings if finding["setting"] == "iq"]
    assert exit_info.value.code in (0, None)
    assert finding["level"] == "warning"
    assert "--iq" in finding["fix"]
