"""Coverage-guided fuzzer of every file reader, based on atheris.

Each kind of file runs in its own process and starts from a small valid file. Every input must give
a cube of the declared shape, or one `RecordingError` or `InvalidFile`. A crash, another exception,
more than 20 s for one file, or more than 700 MB of memory including the libraries is a failure: the
fuzzer stores the input in `fuzz-found/` and exits with status 1.

    python fuzz/readers.py                             every kind, 60 s each
    python fuzz/readers.py --seconds 600 pcap matlab   two kinds, 600 s each
"""

import argparse
import io
import json
import struct
import subprocess
import sys
import tempfile
import wave
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
ARTIFACTS = Path("fuzz-found").absolute()

RADAR_YAML = """\
frame:
  chirp: {start_frequency: 77 GHz, slope: 30 MHz/us, ramp_duration: 30 us,
          sample_rate: 10 MHz, n_samples: 8, sampling: complex}
  n_chirps: 2
  interval: 40 us
"""
LOG = """\
API:select_chip_version,AR1642,0,
API:ChannelConfig,1,1,0,
API:AdcOutConfig,2,1,0,
API:DataFmtConfig,1,2,1,0,1,0,
API:ProfileConfig,0,1435384036,1000,600,6000,0,0,621,0,8,10000,0,0,30,0,
API:ChirpConfig,0,0,0,0,0,0,0,1,0,
API:FrameConfig,0,0,8,16,8000000,0,512,0,
API:SensorStart,0,
"""
CFG = """\
% Platform:xWR18xx
channelCfg 1 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 429 7 57.14 0 0 70 1 8 5209 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 16 0 100 1 0
sensorStart
"""
LUA = """\
START_FREQ = 77 -- GHz
local idle_us = 2 * 5
ar1.SelectChipVersion("XWR1843")
ar1.ChanNAdcConfig(1, 0, 1, 1, 0, 0, 0, 2, 1, 1)
ar1.ProfileConfig(0, START_FREQ, idle_us, 6, 60, 0, 0, 0, 0, 0, 0, 30.0, 0, 8, 5e3, 0, 0, 30)
ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, 1, 0, 0)
ar1.FrameConfig(0, 0, 8, 16, 50, 0, 0, 1)
"""
PCD = """\
VERSION 0.7
FIELDS x y z velocity
SIZE 4 4 4 4
TYPE F F F F
COUNT 1 1 1 1
WIDTH 3
HEIGHT 1
POINTS 3
DATA ascii
10 1 0.5 -2
20 -3 0 0
30 0 1 5
"""


HXX = """\
    .fmcw_startfreq = 76.5,
    .fmcw_bandwidth = 600,
    .fmcw_chirp_rampup = 16.5,
    .fmcw_chirp_period = 20,
    .tx_groups = {0x0001, 0x0000},
    .nchirp = 16,
    .adc_freq = 20,
    .dec_factor = 2,
    .adc_sample_start = 2,
    .rng_nfft = 16,
    .ant_pos = {{0, 0}, {0.5, 0}, {1, 0}, {1.5, 0}, {2, 0}, {2.5, 0}, {3, 0}, {3.5, 0}},
"""


def draw_cube() -> np.ndarray:
    """Draw an integer-valued cube (frame, chirp, rx, sample) of two frames."""
    rng = np.random.default_rng(1)
    parts = rng.integers(-9000, 9000, (2, 2, 2, 1, 8))
    return parts[0] + 1j * parts[1]


def dca1000() -> bytes:
    return np.stack([draw_cube().real, draw_cube().imag], axis=-1).astype("<i2").tobytes() * 32


def dca1000_packets() -> list[bytes]:
    content = dca1000()
    return [
        struct.pack("<I", number) + start.to_bytes(6, "little") + content[start : start + 1456]
        for number, start in enumerate(range(0, len(content), 1456), start=1)
    ]


def pcap() -> bytes:
    content = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for packet in dca1000_packets():
        udp = struct.pack(">HHHH", 4096, 4098, 8 + len(packet), 0) + packet
        frame = bytes(12) + b"\x08\x00" + b"\x45\0" + struct.pack(">H", 20 + len(udp))
        frame += bytes(4) + b"\x40\x11" + bytes(10) + udp
        content += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    return content


def packets_with_lengths() -> bytes:
    return b"".join(p[:4] + struct.pack("<I", len(p) - 10) + p[4:] for p in dca1000_packets())


def npz() -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, cube=draw_cube(), other=np.arange(3))
    return out.getvalue()


def npy() -> bytes:
    out = io.BytesIO()
    np.save(out, draw_cube())
    return out.getvalue()


def matlab() -> bytes:
    import scipy.io

    out = io.BytesIO()
    scipy.io.savemat(out, {"cube": draw_cube()}, do_compression=True)
    return out.getvalue()


def hdf5() -> bytes:
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file.create_dataset("cube", data=draw_cube(), chunks=(1, 2, 1, 8), compression="gzip")
    return out.getvalue()


def text_columns() -> bytes:
    rows = np.stack([draw_cube().real, draw_cube().imag], axis=-1).reshape(-1, 16)
    return "\n".join(";".join(f"{n:.0f}" for n in row) for row in rows).encode()


def complex_text() -> bytes:
    out = io.StringIO()
    np.savetxt(out, draw_cube().reshape(-1, 8) / 32768)
    return out.getvalue().encode()


def complex_samples() -> bytes:
    return (draw_cube() / 32768).astype(np.complex64).tobytes()


def urad() -> bytes:
    return "\n".join(" ".join(str(1900 + n) for n in range(16)) for _ in range(4)).encode()


def calterah() -> bytes:
    words = np.random.default_rng(1).integers(0, 2**32, 257)
    return ",".join(map(str, words.tolist())).encode()


def acconeer() -> bytes:
    import h5py

    subsweep = {"start_point": 100, "num_points": 3, "step_length": 10}
    frames = np.zeros((30, 2, 3), [("real", "<i2"), ("imag", "<i2")])
    frames["real"] = np.random.default_rng(1).integers(-2000, 2000, frames.shape)
    entry = "sessions/session_0/group_0/entry_0"
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file[f"{entry}/result/frame"] = frames
        file[f"{entry}/result/tick"] = 50_000 * np.arange(30)
        file[f"{entry}/sensor_id"] = 2
        file[f"{entry}/metadata"] = json.dumps({"base_step_length_m": 0.0025})
        file["server_info"] = json.dumps({"ticks_per_second": 1_000_000})
        file["sessions/session_0/session_config"] = json.dumps(
            {"groups": [{"2": {"subsweeps": [subsweep]}}]}
        )
    return out.getvalue()


def slow_time_text() -> bytes:
    rows = [f"{0.05 * n:.2f},{n % 7},{n % 5}" for n in range(30)]
    return "\n".join(["time_s,i,q", *rows]).encode()


def sync_wav() -> bytes:
    out = io.BytesIO()
    with wave.open(out, "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(10_000_000)
        sync = np.where(np.arange(400) % 40 < 20, 9000, -9000)
        file.writeframes(np.stack([np.arange(400), sync], axis=-1).astype("<i2").tobytes())
    return out.getvalue()


def continuous_wav() -> bytes:
    out = io.BytesIO()
    with wave.open(out, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(10_000_000)
        file.writeframes(np.arange(4000).astype("<i2").tobytes())
    return out.getvalue()


def sirad() -> bytes:
    head = {"Bandwidth": 6000, "SamplingFrequency": 2.571, "Ramps": 1, "Samps": 8, "PRI": "0.016"}
    return json.dumps({**head, "Gain": 8, "data": [list(range(16))] * 4}).encode()


def ti_uart() -> bytes:
    items = struct.pack("<II4f", 1, 16, 0.5, 2, 0, 0.1) + struct.pack("<II2h", 7, 4, 200, 30)
    words = struct.pack("<8I", 0x03060000, 40 + len(items), 0xA1843, 7, 0, 1, 2, 0)
    return (b"\x02\x01\x04\x03\x06\x05\x08\x07" + words + items) * 3


def infineon() -> bytes:
    shape = {"num_samples_per_chirp": 8, "num_chirps_per_frame": 2, "rx_antennas": [1]}
    shape |= {"start_frequency_Hz": 58e9, "end_frequency_Hz": 63e9, "sample_rate_Hz": 2e6}
    shape |= {"chirp_repetition_time_s": 5e-4, "frame_repetition_time_s": 0.08}
    return json.dumps(
        {"device_config": {"fmcw_single_shape": {**shape, "mimo_mode": "off"}}}
    ).encode()


def mmwave() -> bytes:
    profile = {"profileId": 0, "startFreqConst_GHz": 77, "idleTimeConst_usec": 10}
    profile |= {"adcStartTimeConst_usec": 6, "rampEndTime_usec": 60, "freqSlopeConst_MHz_usec": 30}
    profile |= {"numAdcSamples": 8, "digOutSampleRate": 5000, "rxGain_dB": "0x1E"}
    varied = ("startFreqVar_MHz", "freqSlopeVar_KHz_usec", "idleTimeVar_usec")
    chirp = dict.fromkeys((*varied, "adcStartTimeVar_usec"), 0) | {"txEnable": "0x1"}
    chirp |= {"chirpStartIdx": 0, "chirpEndIdx": 0, "profileId": 0}
    frame = {"chirpStartIdx": 0, "chirpEndIdx": 0, "numLoops": 16, "numFrames": 8}
    radio = {
        "waveformType": "legacyFrameChirp",
        "rlChanCfg_t": {"rxChannelEn": "0x1", "txChannelEn": "0x1"},
        "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 1}},
        "rlProfiles": [{"rlProfileCfg_t": profile}],
        "rlChirps": [{"rlChirpCfg_t": chirp}],
        "rlFrameCfg_t": {**frame, "framePeriodicity_msec": 40},
    }
    capture = {"rlDevDataFmtCfg_t": {"iqSwapSel": 0, "chInterleave": 0}}
    device = {"mmWaveDeviceId": 0, "rfConfig": radio, "rawDataCaptureConfig": capture}
    return json.dumps({"mmWaveDevices": [device]}).encode()


def corpus_reader(name: str) -> Callable[[], bytes]:
    """Return a function that reads a recording of the corpus."""
    return (ROOT / "tests" / "bad_input" / "corpus" / "recording" / name).read_bytes


GENERIC_OPTIONS = {"axes": "frame,chirp,rx,sample", "encoding": "full-scale"}
RECORDINGS: dict[str, tuple[Callable[[], bytes], dict[str, object]]] = {
    "dca1000": (dca1000, {}),
    "headers": (packets_with_lengths, {}),
    "pcap": (pcap, {}),
    "npy": (npy, GENERIC_OPTIONS),
    "npz": (npz, GENERIC_OPTIONS),
    "matlab": (matlab, GENERIC_OPTIONS),
    "hdf5": (hdf5, GENERIC_OPTIONS),
    "kept": (corpus_reader("kept.h5"), {}),
    "mcap": (corpus_reader("mcap.mcap"), {}),
    "radar-scan": (corpus_reader("radar-scan.mcap"), {}),
    "radar-tracks": (corpus_reader("radar-tracks.mcap"), {}),
    "text": (
        text_columns,
        {"format": "text-columns", "axes": "frame,chirp,sample,iq", "encoding": "int16"},
    ),
    "complex-text": (
        complex_text,
        {"format": "text-columns", "axes": "frame,chirp,sample"},
    ),
    "complex-samples": (complex_samples, {"format": "complex-samples", "encoding": "cf32"}),
    "urad": (urad, {"format": "urad"}),
    "urad-pair": (urad, {"format": "urad"}),
    "sync-wav": (sync_wav, {"format": "sync-wav"}),
    "continuous-wav": (continuous_wav, {"format": "continuous-wav"}),
    "sirad": (sirad, {}),
    "pcd": (PCD.encode, {}),
    "ti-uart": (ti_uart, {}),
    "calterah": (calterah, {}),
    "ros1": (corpus_reader("ros1.bag"), {}),
}
SELF_DESCRIBING = {"kept", "mcap", "radar-scan", "radar-tracks", "sirad", "ti-uart", "pcd"}
SELF_DESCRIBING |= {"calterah", "ros1"}
"""Kinds of recordings that contain their radar settings."""
COMPANIONS = {
    "calterah": ("capture", "sensor_config_init0.hxx", HXX.encode),
    "urad-pair": ("I_capture.txt", "Q_capture.txt", urad),
}
"""Names of a recording and of the file beside it, which is not mutated, with its content."""
SLOW_TIME = {"acconeer": (acconeer, "x.h5"), "slow-time-text": (slow_time_text, "x.csv")}
"""Files of slow time, with their names."""
SETTINGS: dict[str, tuple[Callable[[], bytes], str]] = {
    "cfg": (CFG.encode, "x.cfg"),
    "log": (LOG.encode, "x_LogFile.txt"),
    "mmwave-json": (mmwave, "x.mmwave.json"),
    "mmwave-lua": (LUA.encode, "x.lua"),
    "infineon-json": (infineon, "config.json"),
    "calterah-hxx": (HXX.encode, "sensor_config_init0.hxx"),
}


def write_radar(kind: str, folder: Path) -> object:
    """Write the radar settings of a kind of recording to a folder; return the radar."""
    from dechirp.recordings.settings.read import read_settings

    file = folder / "radar.yaml"
    file.write_text(RADAR_YAML.replace("complex", "real") if kind.endswith("wav") else RADAR_YAML)
    return read_settings(file).radar


def write_companion(kind: str, folder: Path) -> Path:
    """Write the file beside a recording, if there is one; return the path of the recording."""
    if kind not in COMPANIONS:
        return folder / "capture"
    name, companion, make_content = COMPANIONS[kind]
    (folder / companion).write_bytes(make_content())
    return folder / name


def build_input_function(kind: str, folder: Path) -> Callable[[bytes], None]:
    """Build the function that reads one input."""
    from dechirp.core.errors import InvalidFile, RecordingError
    from dechirp.recordings.settings.read import read_settings
    from dechirp.recordings.slow_time_files import read_slow_time
    from formats.corruption import assert_cube_or_error

    if kind in SETTINGS or kind in SLOW_TIME:
        file = folder / (SETTINGS | SLOW_TIME)[kind][1]
        read = read_settings if kind in SETTINGS else read_slow_time

        def run_file(content: bytes) -> None:
            file.write_bytes(content)
            try:
                read(file)
            except (RecordingError, InvalidFile) as error:
                assert all(m.value and m.expected and m.fix for m in error.mistakes)

        return run_file
    options = RECORDINGS[kind][1]
    radar_options = {} if kind in SELF_DESCRIBING else {"radar": write_radar(kind, folder)}

    file = write_companion(kind, folder)

    def run_recording(content: bytes) -> None:
        file.write_bytes(content)
        assert_cube_or_error(file, **radar_options, **options)

    return run_recording


def fuzz_kind(kind: str, seconds: int) -> None:
    """Fuzz one kind of file and exit the process."""
    import atheris

    sys.path.insert(0, str(ROOT / "tests"))
    with atheris.instrument_imports(include=["dechirp.recordings"]):
        import dechirp.recordings.recording  # noqa: F401
    with tempfile.TemporaryDirectory() as name:
        folder, corpus = Path(name), Path(name) / "corpus"
        corpus.mkdir()
        (corpus / "valid").write_bytes((RECORDINGS | SETTINGS | SLOW_TIME)[kind][0]())
        run_input = build_input_function(kind, folder)
        run_input((corpus / "valid").read_bytes())
        limits = ["-timeout=20", "-rss_limit_mb=700", "-max_len=65536", "-print_final_stats=1"]
        artifact_option = f"-artifact_prefix={ARTIFACTS}/{kind}-"
        time_option = f"-max_total_time={seconds}"
        atheris.Setup([sys.argv[0], *limits, artifact_option, time_option, str(corpus)], run_input)
        atheris.Fuzz()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "kinds",
        nargs="*",
        metavar="kind",
        default=[*RECORDINGS, *SETTINGS, *SLOW_TIME],
        help=", ".join([*RECORDINGS, *SETTINGS, *SLOW_TIME]),
    )
    parser.add_argument("--seconds", type=int, default=60, help="time per kind of file")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        fuzz_kind(options.kinds[0], options.seconds)
        return
    ARTIFACTS.mkdir(exist_ok=True)
    failed = []
    for kind in options.kinds:
        command = [sys.executable, __file__, "--child", kind, "--seconds", str(options.seconds)]
        process = subprocess.run(command, check=False, capture_output=True, text=True)
        counts = [line for line in process.stderr.splitlines() if "executed_units" in line]
        print(
            f"{kind}: {'failed' if process.returncode else 'passed'} {' '.join(counts)}", flush=True
        )
        if process.returncode:
            failed.append(kind)
            print(process.stderr[-3000:])
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
