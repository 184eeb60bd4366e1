"""Findings on a recording, from the quality measures of its frames."""

import xarray as xr

from dechirp.core.findings import Finding
from dechirp.processing.quality.adc import adc_offset_findings, clipping_findings
from dechirp.processing.quality.chirp_findings import interference_findings, outlier_chirp_findings
from dechirp.processing.quality.iq_mixer import iq_mixer_findings, missing_echo_findings
from dechirp.processing.quality.receivers import (
    faulty_receiver_findings,
    receiver_order_findings,
    silent_frame_findings,
)
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.processing.quality.synchronous_interference import interference_ghost_findings
from dechirp.radar.radar import Radar


def recording_findings(measures: xr.Dataset, radar: Radar) -> tuple[Finding, ...]:
    """Evaluate the measures of the frames of a recording, concatenated along `frame`.

    Returns
    -------
    tuple of Finding
        Notes on usual and warnings on unusual properties; empty for a recording without defects.
        Frames, chirps and receivers are counted from 0.

    Notes
    -----
    Clean noise and echoes cause a warning with a probability below 1e-6: bursts have 1e-12 a
    chirp, echoes and images in noise 1e-9 a frame; all other measures are counts, or have
    thresholds that noise does not reach.
    """
    recorded = RecordingMeasures(measures=measures, radar=radar)
    checks = (
        silent_frame_findings,
        missing_echo_findings,
        faulty_receiver_findings,
        receiver_order_findings,
        iq_mixer_findings,
        clipping_findings,
        adc_offset_findings,
        interference_findings,
        interference_ghost_findings,
        outlier_chirp_findings,
    )
    return tuple(finding for check in checks for finding in check(recorded))
