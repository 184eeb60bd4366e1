"""What single precision costs: each step against double, the table of the guide, and the edges."""

import re
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
import precision_budget as budget
from dechirp.core.units import to_decibels
from precision_budget import STEPS
from small_radars import chain, small

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "limits.md"
UNIT = 2.0**-24
"""Half a unit in the last place of single precision."""


def table() -> dict[str, float]:
    """Steps of the page and the error that each has at most."""
    text = PAGE.read_text().split("## Single precision")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| ([0-9.]+e-[0-9]+) \|", text, flags=re.M)
    return {name: float(most) for name, most in rows}


def test_the_page_has_every_step():
    assert list(table()) == list(STEPS)


@pytest.mark.parametrize("step", STEPS)
def test_a_step_is_as_exact_as_the_page_says(step):
    most, found = table()[step], STEPS[step]()
    # Within it, and not ten times better: processors round sums in different orders.
    assert most / 20 < found <= most


def test_transforms_lose_what_their_stages_round():
    # Each stage of a radix adds products and sums rounded by u / sqrt 3 in the mean; with
    # log2 (128 x 256) = 15 halvings and the window, sqrt(15 + 2) times that, give or take 4.
    stages = np.log2(budget.N_CHIRPS * budget.N_SAMPLES) + 2
    expected = UNIT / np.sqrt(3) * np.sqrt(stages)
    assert expected / 4 < budget.transforms() < 4 * expected


def test_a_cell_of_a_target_is_told_from_rounding_by_140_decibels():
    assert to_decibels(budget.floor() ** 2) < -140


@pytest.mark.parametrize(
    "estimator", [dc.cfar.CellAveraging(), dc.cfar.OrderedStatistic()], ids=str
)
@pytest.mark.parametrize("window", ["hann", "blackman-harris", "chebyshev-80"])
@pytest.mark.parametrize("velocity", [0.0, 3.3, -7.77])
def test_an_echo_without_any_noise_is_one_detection(estimator, window, velocity):
    """What rounding leaves of it, 150 dB below, is over its own mean here and there."""
    radar = small(n_samples=256, n_chirps=64)
    target = dc.Target(position_m=(20, 1, 0), velocity_m_per_s=(velocity, 0, 0))
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    ring = {"n_training": dc.Cells(range=8, velocity=6), "n_guard": dc.Cells(range=4, velocity=4)}
    cfar = dc.Cfar(estimator=estimator, offset=20.0, **ring)
    assert dc.detect(cube, radar, chain(window, cfar=cfar)).sizes["detection"] == 1


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e6])
def test_a_target_100_decibels_under_a_strong_one_is_found_where_it_is(scale):
    """Its sidelobes are taken out with the walk that the strong one has within the frame."""
    radar = small(n_samples=256, n_chirps=64, n_rx=1)
    weak = dc.Target(position_m=(35.3, 0, 0), velocity_m_per_s=(6.3, 0, 0), rcs_m2=1.0)
    strong = dc.Target(
        position_m=(8.2, 0, 0), velocity_m_per_s=(-3.1, 0, 0), rcs_m2=1e10 * (8.2 / 35.3) ** 4
    )
    alone, both = (budget.echoes(dc.Scene(targets=t), radar) for t in ([weak], [weak, strong]))
    # The weak one is 30 dB over the noise after integration.
    std = budget.rms(alone) * np.sqrt(64 * 256 / 1e3 / 2)
    noise = std * (np.random.default_rng(5).standard_normal((*both.shape, 2)) @ (1, 1j))
    cube = dc.simulate(dc.Scene(), radar, impairments=())
    cube = cube.copy(data=(scale * (both + noise)).astype(np.complex64))
    found = dc.detect(cube, radar, chain("blackman-harris"))
    assert found.sizes["detection"] == 2
    one = found.isel(detection=1)
    truth = dc.truth(dc.Scene(targets=[weak]), radar).isel(target=0, frame=0)
    for name in ("range", "velocity"):
        assert abs(float(one[name]) - float(truth[name])) < 6 * float(one[f"{name}_std"])
    assert float(to_decibels(one.snr)) == pytest.approx(30.0, abs=1.5)
