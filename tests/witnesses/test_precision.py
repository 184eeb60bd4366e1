"""Single-precision errors: each step against double precision, the guide's table, and limits."""

import re
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
import precision_budget as budget
from dechirp.core.units import to_decibels
from precision_budget import STEPS
from small_radars import small_chain, small_radar

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "limits.md"
UNIT = 2.0**-24
"""Unit roundoff of single precision."""


def read_table() -> dict[str, float]:
    """Read the steps of the page and their maximum errors."""
    text = PAGE.read_text().split("## Single precision")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| ([0-9.]+e-[0-9]+) \|", text, flags=re.M)
    return {name: float(limit) for name, limit in rows}


def test_page_lists_every_step():
    assert list(read_table()) == list(STEPS)


@pytest.mark.parametrize("step", STEPS)
def test_step_error_is_within_documented_limit(step):
    limit, error = read_table()[step], STEPS[step]()
    # The lower limit keeps the table up to date; processors round sums in different orders.
    assert limit / 20 < error <= limit


def test_transform_error_matches_rounding_of_its_stages():
    # Each radix stage adds rounding errors of u / sqrt 3 RMS; log2 (128 x 256) = 15 halvings and
    # the window give sqrt(15 + 2) times that, within a factor of 4.
    stages = np.log2(budget.N_CHIRPS * budget.N_SAMPLES) + 2
    expected = UNIT / np.sqrt(3) * np.sqrt(stages)
    assert expected / 4 < budget.transform_error() < 4 * expected


def test_rounding_floor_is_140_db_below_target():
    assert to_decibels(budget.rounding_floor() ** 2) < -140


@pytest.mark.parametrize(
    "estimator", [dc.cfar.CellAveraging(), dc.cfar.OrderedStatistic()], ids=str
)
@pytest.mark.parametrize("window", ["hann", "blackman-harris", "chebyshev-80"])
@pytest.mark.parametrize("velocity", [0.0, 3.3, -7.77])
def test_noise_free_echo_gives_one_detection(estimator, window, velocity):
    """Rounding residues, 150 dB below the echo, exceed their own mean in some cells."""
    radar = small_radar(n_samples=256, n_chirps=64)
    target = dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(velocity, 0, 0))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    window_cells = {
        "n_training": dc.Cells(range=8, velocity=6),
        "n_guard": dc.Cells(range=4, velocity=4),
    }
    cfar = dc.Cfar(estimator=estimator, offset=20.0, **window_cells)
    assert dc.detect(cube, radar, small_chain(window, cfar=cfar)).sizes["detection"] == 1


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e6])
def test_target_100_db_below_another_is_detected_at_its_position(scale):
    """The sidelobes of the strong target are subtracted including its range walk in the frame."""
    radar = small_radar(n_samples=256, n_chirps=64, n_rx=1)
    weak = dc.Target(position_m=(35.3, 0, 0), velocity_m_per_s=(6.3, 0, 0), rcs_m2=1.0)
    strong = dc.Target(
        position_m=(8.2, 0, 0), velocity_m_per_s=(-3.1, 0, 0), rcs_m2=1e10 * (8.2 / 35.3) ** 4
    )
    weak_echo, echoes = (
        budget.simulate_echoes(dc.Scene(targets=t), radar) for t in ([weak], [weak, strong])
    )
    # The weak target has 30 dB SNR after integration.
    std = budget.root_mean_square(weak_echo) * np.sqrt(64 * 256 / 1e3 / 2)
    noise = std * (np.random.default_rng(5).standard_normal((*echoes.shape, 2)) @ (1, 1j))
    cube = dc.simulate(dc.Scene(), radar, impairments=())
    cube = cube.copy(data=(scale * (echoes + noise)).astype(np.complex64))
    detections = dc.detect(cube, radar, small_chain("blackman-harris"))
    assert detections.sizes["detection"] == 2
    detection = detections.isel(detection=1)
    truth = dc.truth(dc.Scene(targets=[weak]), radar).isel(target=0, frame=0)
    for name in ("range", "velocity"):
        assert abs(float(detection[name]) - float(truth[name])) < 6 * float(
            detection[f"{name}_std"]
        )
    assert float(to_decibels(detection.snr)) == pytest.approx(30.0, abs=1.5)
