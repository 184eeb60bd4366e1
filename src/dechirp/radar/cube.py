"""Samples with their labels: what a cube is, whether simulated or recorded."""

from typing import Literal

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES, axis, chirp_times, transmitters
from dechirp.core.errors import InvalidSetting
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar


def labelled_cube(
    samples: np.ndarray,
    radar: Radar,
    *,
    units: Literal["sqrt(W)", "full scale"],
    first_frame: int = 0,
) -> xr.DataArray:
    """Label samples (frame, chirp, rx, sample), not copied, with the times of the radar.

    Coordinates: start of each frame and chirp, and of each sample since the start of the
    ramp, all in s; `transmitter` along `chirp`, which one sent it, where they take turns;
    `first_frame` is the number of the first frame. Where intervals differ from frame to frame
    `chirp` counts chirps, and `chirp_time` has the start of each in each frame.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    turns = frame.turns
    n_frames, n_chirps, n_rx, n_samples = samples.shape
    numbers = range(first_frame, first_frame + n_frames)
    starts_s = [frame.start_s(number) for number in numbers]
    slow: dict[str, xr.Variable] = {}
    if frame.n_intervals == 1:
        slow["chirp"] = axis("chirp", frame.chirps_s)
    else:
        slow["chirp"] = xr.Variable("chirp", np.arange(n_chirps), {"units": "1"})
        slow["chirp_time"] = chirp_times(np.array([frame.at(one).chirps_s for one in numbers]))
    return xr.DataArray(
        samples,
        dims=CUBE_AXES,
        coords={
            "frame": axis("frame", np.array(starts_s)),
            **slow,
            **({} if turns is None else {"transmitter": transmitters(turns, n_chirps)}),
            "rx": axis("rx", np.arange(n_rx)),
            "sample": axis(
                "sample", chirp.adc_start_s + np.arange(n_samples) / chirp.sample_rate_hz
            ),
        },
        name="cube",
        attrs={"units": units, "convention": "beat = Tx x conj(Rx), receding positive"},
    )


def must_be_sampled_as(chirp: Chirp, samples: np.ndarray | xr.DataArray, *, where: str) -> None:
    """Raise `InvalidSetting` about `where` unless samples are complex or real as the chirp says."""
    if np.iscomplexobj(samples) != (chirp.sampling == "complex"):
        raise InvalidSetting(
            where,
            got=f"samples of type {samples.dtype}",
            need=f"{chirp.sampling} samples, as the chirp says",
            fix="Set the chirp's sampling to what the converter takes.",
        )
