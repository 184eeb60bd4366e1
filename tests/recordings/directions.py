"""Directions in the real recordings: arrays, calibration and detections."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.angle.fft import Fft
from dechirp.processing.calibration.calibrate import calibrate
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.devices.lookup import device
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import open as open_recording
from recordings.real_recordings import TURNTABLE, open_real_recording

STATIC_SCENE_CFAR = Cfar(
    estimator=CellAveraging(),
    n_training=Cells(range=0, velocity=4),
    n_guard=Cells(range=0, velocity=3),
    false_alarm_probability=1e-6,
)
"""Static laboratory: cells at other velocities contain only noise."""


@cache
def calibrate_radar(folder: Path) -> Calibration:
    """Calibrate the xWR1443 with the reflector at 30 degrees only."""
    recording = open_real_recording(folder, "az_30.raw")
    angle_rad = np.radians(30)
    result = calibrate(recording.frames(), recording.radar, azimuth_rad=angle_rad, range_m=2.05)
    return result.calibration


def detect_reflectors(folder: Path, name: str, angle: DirectionEstimator) -> xr.Dataset:
    """Detect the reflectors of the xWR1443, which are at 2.04 m in all files."""
    recording = open_real_recording(folder, name)
    radar = replace(recording.radar, calibration=calibrate_radar(folder))
    detections = detect(recording.cube, radar, Chain(cfar=STATIC_SCENE_CFAR, angle=angle))
    return detections.isel(detection=np.flatnonzero(abs(detections.range - 2.04) < 0.05))


def detect_turntable_reflector(folder: Path, collection: str) -> xr.Dataset:
    """Detect the reflector at 6.75 m in one of the collections of twelve channels.

    Each collection is one phase-calibrated chirp of twelve receivers and one transmitter. The
    phase rises along the receivers for positive angles, so the array extends towards -y.
    """
    half_m = TURNTABLE.frame.chirp.wavelength_m / 2
    line = Array(rx_m=tuple((0.0, -n * half_m, 0.0) for n in range(12)))
    radar = Radar(frame=replace(TURNTABLE.frame, multiplexing=None), array=line)
    path = folder / f"Assignment1.mat/Collection{collection}"
    recording = open_recording(path, radar=radar, axes="rx,sample")
    detections = detect(recording.cube, radar, Chain(angle=Fft()))
    return detections.isel(detection=np.flatnonzero(abs(detections.range - 6.75) < 0.1))


def detect_people(folder: Path) -> xr.Dataset:
    """Detect the two people in the room, strongest first."""
    single_tx_radar = open_real_recording(folder, "doppler_example_1.npy").radar
    frame = replace(single_tx_radar.frame, interval_s=92e-6, multiplexing=Tdm(order=(0, 1)))
    radar = Radar(frame=frame, array=device("xwr1642").select_antennas(0b11, 0b1111))
    recording = open_recording(
        folder / "doppler_example_1.npy",
        radar=radar,
        axes="chirp,element,sample",
        encoding="uint16-wrapped",
    )
    return detect(recording.cube, radar).sortby("snr", ascending=False)
