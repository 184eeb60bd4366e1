"""From peaks that were drawn to rows of detections, by the same steps as those of a map."""

import numpy as np

from dechirp.experiment.statistical.peaks_drawn import Drawn
from dechirp.process.chain import Chain
from dechirp.process.detect import described
from dechirp.process.folds.ambiguity import Folds, folds, responses, unknown
from dechirp.process.sources import (
    aperture_of,
    sources,
    tells_directions,
    undirected,
)
from dechirp.radar.radar import Radar


def told(drawn: Drawn, radar: Radar, chain: Chain) -> dict[str, np.ndarray]:
    """Columns as those of `process.detect.detect`, but for time; `frame` as it was drawn."""
    frame = radar.frame
    turns = (drawn.slow - 2 * np.pi * _middle(chain, radar) + np.pi) % (2 * np.pi) - np.pi
    doppler_hz = turns / (2 * np.pi * frame.repetition_s)
    known = _folds(drawn, doppler_hz, radar, chain)
    doppler_hz = doppler_hz + np.nan_to_num(known.certain) / frame.repetition_s
    energy = np.sum(np.abs(drawn.amplitude) ** 2, axis=1, dtype=float)
    snr = np.maximum(energy / drawn.noise - radar.n_summed, 1e-3)
    if chain.angle is None:
        of_all = undirected(len(snr))
    else:
        view = aperture_of(radar, chain.field_of_view)
        of_all = sources(drawn.amplitude, doppler_hz, drawn.noise, radar, chain.angle, view)
    columns = described(of_all, drawn.fast, doppler_hz, snr, known, radar)
    return {"frame": drawn.frame[of_all.detection], **columns}


def _middle(chain: Chain, radar: Radar) -> float:
    """Where zero velocity is, over all bins."""
    n_bins = chain.over_velocity(radar.frame).n_bins
    return (n_bins // 2) / n_bins


def _folds(drawn: Drawn, doppler_hz: np.ndarray, radar: Radar, chain: Chain) -> Folds:
    frame = radar.frame
    if frame.n_slots == 1 or frame.n_chirps == 1 or not tells_directions(radar):
        return unknown(len(doppler_hz))
    answers = responses(radar, aperture_of(radar, chain.field_of_view))
    return folds(drawn.amplitude, frame, doppler_hz, answers, drawn.noise)
