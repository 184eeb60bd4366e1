"""Training-window statistics of the statistical sensor, kept on disk."""

import numpy as np

import dechirp as dc
from dechirp.experiments.statistical import training_statistics
from dechirp.experiments.statistical.training_statistics import draw_training_window_statistics
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.spectrum import Transform


def test_statistics_from_disk_equal_drawn_ones(tmp_path, monkeypatch):
    monkeypatch.setenv("DECHIRP_CACHE_DIR", str(tmp_path))
    noise = MapNoise(
        range_transform=Transform(window="hann", n_points=64, n_bins=64),
        doppler_transform=Transform(window="hann", n_points=32, n_bins=32),
    )
    cfar = dc.Chain().cfar
    drawn = draw_training_window_statistics.__wrapped__(cfar, noise)

    def refuse(cfar, noise):
        raise AssertionError("drawn again")

    monkeypatch.setattr(training_statistics, "_draw_statistics", refuse)
    kept = draw_training_window_statistics.__wrapped__(cfar, noise)

    assert len(list(tmp_path.rglob("*.json"))) == 1
    assert np.array_equal(kept.statistic, drawn.statistic)
    assert np.array_equal(kept.corners, drawn.corners)
    assert kept.sensitivity == drawn.sensitivity
