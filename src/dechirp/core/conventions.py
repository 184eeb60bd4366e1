"""Names, units and signs that every labelled array keeps.

Fast time runs along `sample`, slow time along `chirp`. A transform renames the axis it
consumes: sample -> range, chirp -> velocity. Where several transmitters take turns, `chirp`
holds all chirps in the order sent, and the coordinate `transmitter` along it says whose each is;
where several send together it is not there. Where intervals differ from frame to frame, `chirp`
counts chirps, and the coordinate `chirp_time` over `frame` and `chirp` says when each starts.

Range and velocity grow away from the radar: a receding target has positive velocity. The
beat signal is Tx x conj(Rx), so an up-chirp gives positive beat frequencies. x points
forward (boresight), y left, z up; azimuth grows to the left, elevation up.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr

import dechirp.core.accessor  # noqa: F401  # who has labelled arrays has `.dechirp`

AXES = {
    "frame": ("s", "start of the frame"),
    "chirp": ("s", "slow time: start of the chirp, since the start of its frame"),
    "rx": ("1", "receiver"),
    "sample": ("s", "fast time since the start of the ramp"),
    "range": ("m", "distance from the radar"),
    "velocity": ("m/s", "rate of change of range, receding positive"),
    "azimuth": ("rad", "angle to the left of boresight"),
    "elevation": ("rad", "angle above the horizontal"),
}

CUBE_AXES = ("frame", "chirp", "rx", "sample")


def transmitters(turns: Sequence[int], n_chirps: int) -> xr.Variable:
    """Coordinate along `chirp`: which transmitter sent each, its place in `Array.tx_m`.

    `turns` are those of one round.
    """
    numbers = np.resize(np.array(turns), n_chirps)
    return xr.Variable("chirp", numbers, {"units": "1", "long_name": "transmitter of the chirp"})


def chirp_times(times_s: np.ndarray) -> xr.Variable:
    """Coordinate over `frame` and `chirp`, where one axis cannot hold the times of all frames."""
    units, long_name = AXES["chirp"]
    return xr.Variable(("frame", "chirp"), times_s, {"units": units, "long_name": long_name})


def axis(name: str, values: np.ndarray) -> xr.Variable:
    """Coordinate of a labelled array, with the units and words of the table."""
    units, long_name = AXES[name]
    return xr.Variable(name, values, {"units": units, "long_name": long_name})
