"""Settings fragments and links of the documentation pages."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.core.dimensions import DIMENSIONS
from dechirp.experiments.scenario import Scenario
from nightly import nightly

DOCS = Path(dc.__file__).parents[2] / "docs"
RADAR = """
radar:
  frame:
    chirp: {start_frequency: 76.5 GHz, slope: 15 MHz/us, adc_start: 2 us, ramp_duration: 16 us,
            sample_rate: 20 MHz, n_samples: 128, sampling: complex}
    n_chirps: 64
    interval: 25 us
  array: {tx: [[0, 20 mm, 0]], rx: [[0, 0, 0], [0, 2 mm, 0]]}
  hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
scene: {targets: [{position: [20 m, 0, 0]}]}
"""


def read_settings_fragments(page: str) -> list[str]:
    """Return the settings fragments of a page; complete files run when the guide is built."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(r"```\{settings\}\n(?::over:[^\n]*\n)?([^:].*?)```", text, re.DOTALL)


@pytest.mark.parametrize("text", read_settings_fragments("hardware.md"))
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_documented_impairment_simulates(text):
    scenario = parse_settings(text + RADAR, Scenario)
    assert scenario.impairments
    cube = dc.simulate(scenario.scene, scenario.radar, impairments=scenario.impairments)
    assert abs(cube).max() > 0


@pytest.mark.parametrize(
    "text", [t for t in read_settings_fragments("scenes.md") if "  targets:\n" in t]
)
def test_every_documented_target_loads(text):
    without_scene = RADAR[: RADAR.index("scene:")]
    scenario = parse_settings(f"{text}{without_scene}", Scenario)
    assert scenario.scene.n_scatterers >= len(scenario.scene.targets) > 0


@pytest.fixture(scope="module")
def mimo_scenario() -> dc.Scenario:
    return dc.load(DOCS.parent / "examples" / "mimo.yaml", ["n_frames=1"])


@nightly
@pytest.mark.parametrize("text", read_settings_fragments("angles.md"))
def test_every_documented_chain_detects_car(text, mimo_scenario):
    chain = parse_settings(text + RADAR, Scenario).chain

    detections = dc.run(replace(mimo_scenario, chain=chain)).detections

    car = detections.isel(detection=int(abs(detections.velocity.values - 6).argmin()))
    assert abs(float(car.range) - 60.05) < 0.05
    assert abs(float(car.azimuth) + 0.033) < 5 * float(car.azimuth_std)


@pytest.mark.parametrize("text", read_settings_fragments("tracks.md"))
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_documented_tracker_runs(text):
    scenario = parse_settings(text + RADAR, Scenario, overrides=["n_frames=3"])

    result = dc.run(scenario)

    has_tracker = scenario.tracker is not None or scenario.group_tracker is not None
    assert (result.clusters is not None) == (scenario.tracker is not None)
    assert (result.tracks is not None) == has_tracker
    assert has_tracker or scenario.chain.mitigation


@nightly
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_highway_example_has_documented_tracks_and_ego_speed():
    result = dc.run(dc.load(DOCS.parent / "examples" / "highway.yaml"))

    assert result.tracks.isel(frame=-1).sizes["track"] == 13
    assert abs(float(result.ego.vx[-1]) - 30) < 0.1
    assert {"cluster", "motion"} <= set(result.detections)


@pytest.mark.parametrize(
    "page",
    [
        "angles.md",
        "fixed-point.md",
        "lessons.md",
        "recordings.md",
        "scenes.md",
        "silicon.md",
        "slow-time.md",
        "studio.md",
        "tracks.md",
    ],
)
def test_links_between_pages_resolve(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    for name, section in re.findall(r"\]\(([\w./-]+)(?:#([\w-]+))?\)", text):
        assert (DOCS / name).exists(), name
        if section:
            headings = re.findall(r"^#+ (.*)$", (DOCS / name).read_text(encoding="utf-8"), re.M)
            assert section in {heading.lower().replace(" ", "-") for heading in headings}, section


def test_conventions_list_units_of_all_dimensions():
    text = (DOCS / "guide" / "conventions.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:`_(\w+)`|none: a ratio) \| (.*) \| (.*) \|$", text, re.MULTILINE)
    assert [(suffix or None, *cells) for suffix, *cells in rows] == [
        (suffix, dimension.description, ", ".join(dimension.units_for_messages))
        for suffix, dimension in DIMENSIONS.items()
        if dimension.units_for_messages
    ]
