"""Real recordings, opened with the settings of their README files."""

from pathlib import Path
from typing import Any

from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.devices.lookup import device
from dechirp.radar.frame import Frame
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording

EXAMPLE_RADAR = Path(__file__).parents[2] / "examples" / "radar.yaml"

ROADSIDE = Radar(
    frame=Frame(
        chirp=Chirp(
            start_frequency_hz=77e9,
            slope_hz_per_s=29.306e12,
            ramp_duration_s=28e-6,
            sample_rate_hz=20e6,
            n_samples=512,
            sampling="complex",
        ),
        n_chirps=128,
        interval_s=29.56e-6,
    ),
    array=device("xwr1243").select_antennas(0b001, 0b1111),
)

TEST_SOURCE = Radar(
    frame=Frame(
        chirp=Chirp(
            start_frequency_hz=77e9,
            slope_hz_per_s=70e12,
            ramp_duration_s=57.14e-6,
            sample_rate_hz=5.209e6,
            n_samples=256,
            sampling="complex",
        ),
        n_chirps=4,
        interval_s=486.14e-6,
    ),
    array=device("xwr1843").select_antennas(0b001, 0b1111),
)

# The radar has one mixer, but each channel was multiplied by a complex number to calibrate its
# phase: samples are complex, and every echo has an image at the mirrored beat frequency. The
# sweep of 30.6 us follows a reset of 5 us and a dwell of 1 us.
TURNTABLE = Radar(
    frame=Frame(
        chirp=Chirp(
            start_frequency_hz=78_819_008_512.0 - 1_005_539_072.0 / 2,
            slope_hz_per_s=32_860_753_986_928.098,
            ramp_duration_s=30.6e-6,
            sample_rate_hz=40e6,
            n_samples=1024,
            sampling="complex",
        ),
        n_chirps=1,
        interval_s=36.6e-6,
        multiplexing=Tdm(order=(0, 1, 2)),
    ),
    array=Array(
        tx_m=tuple((0.0, 4 * n * 1.902e-3, 0.0) for n in range(3)),
        rx_m=tuple((0.0, n * 1.902e-3, 0.0) for n in range(4)),
    ),
)


def make_sound_card_radar(start_hz: float, slope_hz_per_s: float, interval_s: float) -> Radar:
    """Make a radar whose beat signal a sound card recorded: 20 ms of each ramp."""
    chirp = Chirp(
        start_frequency_hz=start_hz,
        slope_hz_per_s=slope_hz_per_s,
        ramp_duration_s=20e-3,
        sample_rate_hz=44_100.0,
        n_samples=882,
        sampling="real",
    )
    return Radar(frame=Frame(chirp=chirp, n_chirps=1, interval_s=interval_s))


COFFEE_CAN = make_sound_card_radar(2.2258e9, 6.945e9, 40.9e-3)
KTH = make_sound_card_radar(2.408e9, 4.35e9, 41.11e-3)


def open_real_recording(folder: Path, name: str) -> Recording:
    """Open one recording of the collection with its settings."""
    return open_recording(folder / name, **missing_metadata(folder, name))


def missing_metadata(folder: Path, name: str) -> dict[str, Any]:  # noqa: PLR0911
    """Return the options of `open` that a recording needs: settings that its folder lacks."""
    match folder.name:
        case "awr1243_interference":
            return {"radar": ROADSIDE}
        case "dca1000_pcap":
            return {"radar": TEST_SOURCE, "device": "xwr1843", "iq": "qi"}
        case "coffeecan_vehicles":
            return {"radar": COFFEE_CAN}
        case "kth_walker":
            return {"radar": KTH}
        case "mimo12_known_angles_mat":
            return {"radar": TURNTABLE, "axes": "element,sample"}
        case "openradar_people":
            axes = "chirp,sample" if name.startswith("simple") else "chirp,rx,sample"
            return {"radar": EXAMPLE_RADAR, "axes": axes, "encoding": "uint16-wrapped"}
        case "xwr1443_known_angles":
            settings = "radar_1GHz.cfg" if "1GHz" in name else "radar_full_band.cfg"
            return {"radar": folder / settings, "device": "xwr1443"}
    return {}


RECORDINGS = {
    "awr1243_interference": ("20180613-190347.bin", "20181128-214451.bin"),
    "awr1642_vibrating_pipe": ("vibration_2.bin", "no_vibration_2.bin"),
    "bgt60_breathing": ("RadarIfxAvian_00",),
    "bgt60_people_room": ("RadarIfxAvian_00",),
    "bgt60_two_reflectors": ("RadarIfxAvian_00",),
    "coffeecan_vehicles": ("car_32mph.wav", "suv_25mph.wav"),
    "dca1000_pcap": ("one_frame.pcap",),
    "kth_walker": ("single_target_range.wav",),
    "mimo12_known_angles_mat": tuple(f"Assignment1.mat/Collection{c}" for c in "ABCD"),
    "openradar_people": ("simple_frame_1.npy", "doppler_example_1.npy"),
    "sirad122_walk": ("giulioCammina.json",),
    "uart_tlv_awr2944": ("awr2944_stream.dat",),
    "xwr1443_known_angles": (
        *(f"az_{angles}.raw" for angles in ("-10", "30", "50", "-1010", "3050")),
        *(f"az_{angles}_1GHz.raw" for angles in ("10", "50", "1030", "3050")),
    ),
}
"""Recordings of each folder; mmwavestudio_json holds only settings."""
