"""Scenes to begin with, as changes of the scene that the studio opens with."""

from dataclasses import replace
from importlib.util import find_spec

from dechirp.config.loading import parse_settings
from dechirp.experiments.scenario import Scenario
from dechirp.studio.browser_events import read_studio_asset_text
from dechirp.studio.scenario_edits import PageLimits, apply_overrides

PRESETS = {
    "crossroads": ("Crossroads: pedestrian, bicyclist, cars", ()),
    "two-cells": (
        "Two targets two range cells apart",
        (
            "scene.targets=[{name: near, position: [30 m, 0 m, 0 m], rcs: 0 dBsm},"
            " {name: far, position: [30.8 m, 0 m, 0 m], rcs: 0 dBsm}]",
        ),
    ),
    "weak-beside-strong": (
        "A weak target beside one 40 dB stronger",
        (
            "scene.targets=[{name: truck, position: [40 m, 0 m, 0 m], rcs: 25 dBsm},"
            " {name: pedestrian, position: [44 m, 3 m, 0 m], velocity: [1 m/s, 0 m/s, 0 m/s],"
            " rcs: -15 dBsm}]",
            "chain.range_window=rectangular",
        ),
    ),
    "fast-car": (
        "A car too fast for the chirp interval",
        (
            "scene.targets=[{name: car, position: [25 m, -3 m, 0 m],"
            " velocity: [15 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}]",
            "n_frames=80",
        ),
    ),
    "interference": (
        "A target and the radar of another car",
        (
            "scene.targets=[{name: car, position: [50 m, -3 m, 0 m],"
            " velocity: [3 m/s, 0 m/s, 0 m/s], rcs: 10 dBsm}]",
            "tracker=null",  # would begin a track at each of the many false detections
            "impairments=[{kind: thermal-noise}, {kind: interference, interferers: [{name: other,"
            " start_frequency: 76.9 GHz, slope: 40 MHz/us, ramp_duration: 12 us, interval: 15.3 us,"
            " transmit_power: 12 dBm, antenna_gain: 12 dBi, position: [60 m, 5 m, 0 m]}]}]",
        ),
    ),
}
"""Title and PATH=VALUE options by name."""


def preset_scenario(name: str, limits: PageLimits) -> Scenario:
    """Return a preset; without tracks where the tracker is not installed.

    Raises
    ------
    DechirpError
        If a limit of the page is lower than usual.
    """
    start = parse_settings(read_studio_asset_text("start.yaml"), Scenario)
    if find_spec("stonesoup") is None:
        start = replace(start, tracker=None)
    _, options = PRESETS[name]
    return replace(apply_overrides(start, options, limits), name=name) if options else start
