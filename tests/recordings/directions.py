"""How directions are taken from the real recordings: arrays, calibration, and what stands still."""

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
from recordings.opened import TURNTABLE, opened

STILL = Cfar(
    estimator=CellAveraging(),
    n_training=Cells(range=0, velocity=4),
    n_guard=Cells(range=0, velocity=3),
    false_alarm_probability=1e-6,
)
"""Everything in the laboratory stands still: noise is where something would move."""


@cache
def calibration(folder: Path) -> Calibration:
    """Of the xWR1443, from the reflector at 30 degrees alone."""
    recording = opened(folder, "az_30.raw")
    angle_rad = np.radians(30)
    found = calibrate(recording.frames(), recording.radar, azimuth_rad=angle_rad, range_m=2.05)
    return found.calibration


def of_reflectors(folder: Path, name: str, angle: DirectionEstimator) -> xr.Dataset:
    """Detections of the xWR1443 about 2.04 m, where reflectors stand in all of its files."""
    recording = opened(folder, name)
    radar = replace(recording.radar, calibration=calibration(folder))
    found = detect(recording.cube, radar, Chain(cfar=STILL, angle=angle))
    return found.isel(detection=np.flatnonzero(abs(found.range - 2.04) < 0.05))


def on_the_turntable(folder: Path, collection: str) -> xr.Dataset:
    """Detections about 6.7 m in one of the collections of twelve channels.

    They are of one chirp each, phases calibrated: twelve receivers of one transmitter, along
    which the phase rises for positive angles, so that they run towards -y.
    """
    half_m = TURNTABLE.frame.chirp.wavelength_m / 2
    line = Array(rx_m=tuple((0.0, -n * half_m, 0.0) for n in range(12)))
    radar = Radar(frame=replace(TURNTABLE.frame, multiplexing=None), array=line)
    path = folder / f"Assignment1.mat/Collection{collection}"
    recording = open_recording(path, radar=radar, axes="rx,sample")
    found = detect(recording.cube, radar, Chain(angle=Fft()))
    return found.isel(detection=np.flatnonzero(abs(found.range - 6.75) < 0.1))


def of_people(folder: Path) -> xr.Dataset:
    """Detections of the two people in the room, strongest first."""
    one = opened(folder, "doppler_example_1.npy").radar
    frame = replace(one.frame, interval_s=92e-6, multiplexing=Tdm(order=(0, 1)))
    radar = Radar(frame=frame, array=device("xwr1642").select_antennas(0b11, 0b1111))
    recording = open_recording(
        folder / "doppler_example_1.npy",
        radar=radar,
        axes="chirp,element,sample",
        encoding="uint16-wrapped",
    )
    return detect(recording.cube, radar).sortby("snr", ascending=False)
