"""Kept threshold factors: those of the package, and those on disk.

python tests/physics/test_cfar_factor_cache.py [CHANNELS ...]   adds those of the package
python tests/physics/test_cfar_factor_cache.py studio           adds those of the studio's start
"""

import gc
import json
import sys
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import platformdirs
import pytest

from dechirp.config.loading import parse_settings
from dechirp.core.disk_cache import cache_folder, key_hash
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.scenario import Scenario
from dechirp.processing.cfar import base, factor_cache
from dechirp.processing.cfar.base import Cells, Cfar, MapNoise, NoiseEstimator, factor_key
from dechirp.processing.cfar.factor_cache import (
    SHIPPED_FACTORS_FILE,
    RowFactors,
    find_or_calibrate_factors,
)
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.processing.spectrum import Transform
from nightly import nightly

# Sums of the channels of common radars: one receiver, two, three, four, 2 x 4 and 3 x 4.
SHIPPED_CHANNELS = (1, 2, 3, 4, 8, 12)
KINDS = sorted(NoiseEstimator.members())
SMALL = Cfar(
    estimator=OrderedStatistic(),
    n_training=Cells(range=3, velocity=2),
    n_guard=Cells(range=2, velocity=2),
    false_alarm_probability=1e-3,
)


def map_noise(n_samples=64, n_chirps=32, n_channels=1, window="hann"):
    """Return the noise of a map without padding."""
    transforms = (Transform(window=window, n_points=n, n_bins=n) for n in (n_samples, n_chirps))
    return MapNoise(
        range_transform=next(transforms),
        doppler_transform=next(transforms),
        n_channels=n_channels,
    )


def default_cfar(kind):
    """Return a detector with default settings."""
    return Cfar(estimator=NoiseEstimator.members()[kind](), false_alarm_probability=1e-6)


def studio_cfar_and_noise(kind):
    """Return a detector and the noise of the scenario with which the studio starts."""
    start = resources.files("dechirp.studio").joinpath("start.yaml").read_text()
    scenario = parse_settings(start, Scenario)
    chain = scenario.chain.fit_to_radar(scenario.radar)
    cfar = replace(chain.cfar, estimator=NoiseEstimator.members()[kind]())
    return cfar, chain.map_noise_statistics(scenario.radar)


@pytest.fixture
def cache_dir(tmp_path, monkeypatch):
    """Return an empty folder for factors on disk; the package contains none."""
    monkeypatch.setenv("DECHIRP_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(factor_cache, "_shipped_factors", dict)
    return tmp_path / "cache"


def find_factors(cfar, noise, calibrate):
    """Return the kept factors of a detector, or those that `calibrate` computes."""
    n_rows = 2 * cfar.training_window.half_range + 1
    key = factor_key(cfar, noise)
    return find_or_calibrate_factors(key, type(cfar.estimator), n_rows, calibrate)


def kept_files(folder):
    return sorted(folder.rglob("*.json"))


def refuse_to_calibrate():
    raise AssertionError("calibrated although factors are kept")


def test_factors_are_calibrated_once_and_read_bit_for_bit_afterwards(cache_dir):
    first = find_factors(SMALL, map_noise(), lambda: base.calibrate_row_factors(SMALL, map_noise()))

    again = find_factors(SMALL, map_noise(), refuse_to_calibrate)

    assert len(kept_files(cache_dir)) == 1
    assert again == first


def test_cosine_windows_of_any_length_have_the_same_key():
    # The correlation of Hann-windowed noise is 1, -2/3 and 1/6 for any length.
    assert factor_key(SMALL, map_noise(64, 32)) == factor_key(SMALL, map_noise(2200, 128))


@pytest.mark.parametrize(
    ("cfar", "noise"),
    [
        (replace(SMALL, estimator=OrderedStatistic(rank=0.7)), map_noise()),
        (replace(SMALL, n_training=Cells(range=3, velocity=3)), map_noise()),
        (replace(SMALL, n_guard=Cells(range=2, velocity=1)), map_noise()),
        (replace(SMALL, false_alarm_probability=2e-3), map_noise()),
        (SMALL, map_noise(n_channels=2)),
        (SMALL, map_noise(window="hamming")),
        (
            SMALL,
            replace(map_noise(), range_transform=Transform(window="hann", n_points=64, n_bins=128)),
        ),
    ],
    ids=["rank", "training", "guard", "probability", "channels", "window", "padding"],
)
def test_everything_that_changes_factors_changes_the_key(cfar, noise):
    assert factor_key(cfar, noise) != factor_key(SMALL, map_noise())


@pytest.mark.parametrize("damage", ["cut", "changed", "of another key", "a folder"])
def test_damaged_entry_is_calibrated_again(cache_dir, damage):
    factors = RowFactors(values=tuple(np.arange(1.0, 12.0).tolist()), relative_error=0.01)
    find_factors(SMALL, map_noise(), lambda: factors)
    (file,) = kept_files(cache_dir)
    entry = json.loads(file.read_text())
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-10])
    elif damage == "changed":
        file.write_text(json.dumps({**entry, "numbers": [0.01, *range(2, 13)]}))
    elif damage == "of another key":
        file.write_text(json.dumps({**entry, "key": {**entry["key"], "n_channels": 2}}))
    else:
        file.unlink()
        file.mkdir()

    assert find_factors(SMALL, map_noise(), lambda: factors) == factors
    if damage != "a folder":
        assert json.loads(file.read_text()) == entry


def test_folder_that_cannot_be_written_is_not_used(cache_dir):
    cache_dir.write_text("a file")
    factors = RowFactors(values=tuple(np.arange(1.0, 12.0).tolist()), relative_error=0.01)

    assert find_factors(SMALL, map_noise(), lambda: factors) == factors


def test_empty_variable_keeps_nothing(cache_dir, monkeypatch):
    monkeypatch.setenv("DECHIRP_CACHE_DIR", "")
    factors = RowFactors(values=tuple(np.arange(1.0, 12.0).tolist()), relative_error=0.01)

    assert find_factors(SMALL, map_noise(), lambda: factors) == factors
    assert not cache_dir.exists()


def test_user_without_home_folder_keeps_nothing(monkeypatch):
    def refuse(*arguments, **options):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("DECHIRP_CACHE_DIR", raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_path", refuse)

    assert cache_folder() is None


@pytest.fixture
def forget_classes():
    """Remove the classes of a test: until then they are detectors of all other tests."""
    yield
    gc.collect()


def test_detector_without_file_is_not_kept(forget_classes, cache_dir, monkeypatch):
    @frozen_dataclass
    class FromNotebook(OrderedStatistic):
        pass

    monkeypatch.setattr(FromNotebook, "__module__", "a_notebook")
    cfar = replace(SMALL, estimator=FromNotebook())
    factors = RowFactors(values=tuple(np.arange(1.0, 12.0).tolist()), relative_error=0.01)
    find_factors(cfar, map_noise(), lambda: factors)

    assert kept_files(cache_dir) == []


@pytest.mark.parametrize("kind", KINDS)
def test_package_contains_factors_of_every_detector(kind):
    shipped = json.loads(SHIPPED_FACTORS_FILE.read_text())

    for n_channels in SHIPPED_CHANNELS:
        assert key_hash(factor_key(default_cfar(kind), map_noise(n_channels=n_channels))) in shipped


@pytest.mark.parametrize("kind", KINDS)
def test_package_contains_factors_of_every_detector_in_the_start_scenario_of_the_studio(kind):
    shipped = json.loads(SHIPPED_FACTORS_FILE.read_text())

    assert key_hash(factor_key(*studio_cfar_and_noise(kind))) in shipped


@pytest.mark.parametrize(
    "kind", ["cell-averaging", *(pytest.param(k, marks=nightly) for k in KINDS)]
)
def test_factors_of_package_are_those_of_a_new_calibration(kind):
    cfar, noise = default_cfar(kind), map_noise()
    shipped = json.loads(SHIPPED_FACTORS_FILE.read_text())[key_hash(factor_key(cfar, noise))]

    # The same draws: rounding of other processors changes them by 1e-6 at most.
    np.testing.assert_allclose(
        base.calibrate_row_factors(cfar, noise).to_numbers(), shipped, rtol=1e-5
    )


def write_shipped_factors(calibrations):
    """Add the factors of these detectors and noises to those of the package."""
    shipped = {}
    if SHIPPED_FACTORS_FILE.exists():
        shipped = json.loads(SHIPPED_FACTORS_FILE.read_text())
    for cfar, noise in calibrations:
        numbers = base.calibrate_row_factors(cfar, noise).to_numbers()
        shipped[key_hash(factor_key(cfar, noise))] = [float(f"{x:.9g}") for x in numbers]
        print(cfar, noise.n_channels, flush=True)
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(shipped[key])}" for key in sorted(shipped))
    Path(SHIPPED_FACTORS_FILE).write_text(f"{{\n{lines}\n}}\n")


if __name__ == "__main__":
    words = sys.argv[1:] or ["studio", *map(str, SHIPPED_CHANNELS)]
    write_shipped_factors(
        studio_cfar_and_noise(kind)
        if word == "studio"
        else (default_cfar(kind), map_noise(n_channels=int(word)))
        for word in words
        for kind in KINDS
    )
