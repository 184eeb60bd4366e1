"""LOG/CFAR plug-in: false-alarm probability and effect of one strong training cell."""

import numpy as np
import pytest
import xarray as xr
from dechirp_guests.log_mean import LogMean

import dechirp as dc
from dechirp.extensions import NoiseEstimator, TrainingWindow

WINDOW = TrainingWindow(
    n_training=dc.Cells(range=3, velocity=2), n_guard=dc.Cells(range=2, velocity=2)
)


def test_factor_of_one_training_cell_follows_ratio_of_two_exponentials():
    for pfa in (0.3, 1e-2, 1e-4):
        factor = LogMean().independent_cells_threshold_factor(pfa, np.ones((1, 2)), n_channels=1)
        assert factor == pytest.approx(1 / pfa - 1, rel=1e-6)


@pytest.mark.parametrize("window", ["rectangular", "hann"])
def test_false_alarm_rate_in_noise_matches_setting(radar, window):
    """Use the exact law with a rectangular window, and calibration by the package with another."""
    cfar = dc.Cfar(
        estimator=LogMean(),
        n_training=WINDOW.n_training,
        n_guard=WINDOW.n_guard,
        false_alarm_probability=1e-2,
    )
    chain = dc.Chain(range_window=window, doppler_window=window, cfar=cfar)
    rng = np.random.default_rng(1)
    hits = trials = 0
    for _ in range(40):
        noise = rng.normal(size=(64, 2, 256, 2)).astype(np.float32).view(np.complex64)[..., 0]
        cube = xr.DataArray(noise, dims=("chirp", "rx", "sample"))
        power = dc.power_map(cube, radar, chain)
        alarms = (power > dc.threshold_map(power, radar, chain)).values
        hits, trials = hits + alarms.sum(), trials + alarms.size
    # A Hann window leaves 1 / 1.5^2 of the cells independent, shared training cells increase
    # the spread by less than 1.5, and the calibration is good to 1 %: five standard errors.
    error = np.hypot(1.5 * 1.5 / np.sqrt(1e-2 * trials), 0.01)
    assert hits / trials == pytest.approx(1e-2, rel=5 * error)


def test_strong_cell_raises_threshold_by_its_nth_root():
    power = np.ones((40, 60), np.float32)
    power[20, 30] = 1e3
    factors = np.full(60, 2.0, np.float32)
    levels = LogMean().threshold(power, WINDOW, factors)

    n_training = WINDOW.n_training_cells_per_row(60)[35]
    assert levels[20, 35] == pytest.approx(2 * 1e3 ** (1 / n_training), rel=1e-4)
    cell_by_cell = NoiseEstimator.threshold(LogMean(), power, WINDOW, factors)
    assert levels == pytest.approx(cell_by_cell, rel=1e-4)
    power[5:8] = 0  # a map may have cells without power
    assert np.isfinite(LogMean().threshold(power, WINDOW, factors)).all()


def test_settings_select_estimator_by_kind():
    scenario = dc.reference(["chain.cfar.estimator={kind: log-mean}"])
    assert scenario.chain.cfar.estimator == LogMean()
    with pytest.raises(dc.InvalidFile, match="unknown setting"):
        dc.reference(["chain.cfar.estimator={kind: log-mean, rank: 3}"])
