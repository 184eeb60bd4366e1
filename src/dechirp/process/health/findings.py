"""What looks wrong with a recording, in sentences, from the measures of its frames."""

import xarray as xr

from dechirp.core.findings import Finding
from dechirp.process.health.converter import clipping, offset
from dechirp.process.health.disturbances import interference, odd_chirps
from dechirp.process.health.mixer import echoes, sides
from dechirp.process.health.receivers import order, receivers, silence
from dechirp.process.health.recorded import Recorded
from dechirp.process.health.walks import ghosts
from dechirp.radar.radar import Radar


def findings(measures: xr.Dataset, radar: Radar) -> tuple[Finding, ...]:
    """Judge the measures of the frames of a recording, concatenated along `frame`.

    Returns
    -------
    tuple of Finding
        Notes on what is usual and warnings of what is not; empty for a healthy recording.
        Frames, chirps and receivers are counted from 0.

    Notes
    -----
    Clean noise and echoes give a warning with a chance below 1e-6: bursts have 1e-12 a chirp,
    echoes and images in noise 1e-9 a frame; everything else is counted, or has thresholds
    that noise does not reach.
    """
    recorded = Recorded(measures=measures, radar=radar)
    checks = (
        silence,
        echoes,
        receivers,
        order,
        sides,
        clipping,
        offset,
        interference,
        ghosts,
        odd_chirps,
    )
    return tuple(finding for check in checks for finding in check(recorded))
