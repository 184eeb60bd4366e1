"""Design, simulate, process and prove FMCW radars, on simulated and recorded echoes alike.

    import dechirp as dc

    radar = dc.design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100).radar
    scene = dc.Scene(targets=[dc.Target(position_m=(50, 0, 0), rcs_m2=10)])
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)

Each name is loaded when it is first used, so that importing the package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dechirp.core.errors import (
        DechirpError,
        InvalidFile,
        InvalidSetting,
        NotEnoughMemory,
        RecordingError,
    )
    from dechirp.core.findings import Finding, PhysicsWarning
    from dechirp.echoes.echo import plan, simulate
    from dechirp.echoes.engine import Engine
    from dechirp.echoes.impairments.thermal_noise import ThermalNoise
    from dechirp.echoes.impairments.white_noise import WhiteNoise
    from dechirp.experiment.inspection import Inspection, inspect
    from dechirp.experiment.run import Result, run
    from dechirp.experiment.scenario import Scenario, Source, load, reference
    from dechirp.experiment.verify.certificate import Certificate, verify
    from dechirp.formats.recording import Recording, open
    from dechirp.formats.settings.write_ti_cfg import ti_cfg_text
    from dechirp.process.cfar.base import Cells, Cfar
    from dechirp.process.cfar.cell_averaging import CellAveraging
    from dechirp.process.chain import Chain, detect, power_map, threshold_map
    from dechirp.radar.array import Array
    from dechirp.radar.chirp import Chirp
    from dechirp.radar.design import Design, design
    from dechirp.radar.devices.base import Device
    from dechirp.radar.devices.known import device
    from dechirp.radar.frame import Frame
    from dechirp.radar.hardware import Hardware
    from dechirp.radar.multiplexing.bpm import Bpm
    from dechirp.radar.multiplexing.ddma import Ddma
    from dechirp.radar.multiplexing.phase_code import PhaseCode
    from dechirp.radar.multiplexing.tdm import Tdm
    from dechirp.radar.patterns.cosine import CosinePattern
    from dechirp.radar.patterns.patch_array import PatchArray
    from dechirp.radar.patterns.table import TablePattern
    from dechirp.radar.radar import Radar
    from dechirp.radar.requirements import Requirements
    from dechirp.scene.bodies.cloud import Cloud
    from dechirp.scene.bodies.points import Oscillation, Points, Rotation, Scatterer
    from dechirp.scene.ego import Ego
    from dechirp.scene.rcs_table import RcsTable
    from dechirp.scene.scene import Scene
    from dechirp.scene.target import Target
    from dechirp.scene.truth import truth
    from dechirp.scene.waypoints import Waypoint

_WHERE = {
    "core.errors": "DechirpError InvalidFile InvalidSetting NotEnoughMemory RecordingError",
    "core.findings": "Finding PhysicsWarning",
    "echoes.echo": "plan simulate",
    "echoes.engine": "Engine",
    "echoes.impairments.thermal_noise": "ThermalNoise",
    "echoes.impairments.white_noise": "WhiteNoise",
    "experiment.inspection": "Inspection inspect",
    "experiment.run": "Result run",
    "experiment.scenario": "Scenario Source load reference",
    "experiment.verify.certificate": "Certificate verify",
    "formats.recording": "Recording open",
    "formats.settings.write_ti_cfg": "ti_cfg_text",
    "process.cfar.base": "Cells Cfar",
    "process.cfar.cell_averaging": "CellAveraging",
    "process.chain": "Chain detect power_map threshold_map",
    "radar.array": "Array",
    "radar.chirp": "Chirp",
    "radar.design": "Design design",
    "radar.devices.base": "Device",
    "radar.devices.known": "device",
    "radar.frame": "Frame",
    "radar.hardware": "Hardware",
    "radar.multiplexing.bpm": "Bpm",
    "radar.multiplexing.ddma": "Ddma",
    "radar.multiplexing.phase_code": "PhaseCode",
    "radar.multiplexing.tdm": "Tdm",
    "radar.patterns.cosine": "CosinePattern",
    "radar.patterns.patch_array": "PatchArray",
    "radar.patterns.table": "TablePattern",
    "radar.radar": "Radar",
    "radar.requirements": "Requirements",
    "scene.bodies.cloud": "Cloud",
    "scene.bodies.points": "Oscillation Points Rotation Scatterer",
    "scene.ego": "Ego",
    "scene.rcs_table": "RcsTable",
    "scene.scene": "Scene",
    "scene.target": "Target",
    "scene.truth": "truth",
    "scene.waypoints": "Waypoint",
}
_MODULE = {name: module for module, names in _WHERE.items() for name in names.split()}

__all__ = [
    "Array",
    "Bpm",
    "CellAveraging",
    "Cells",
    "Certificate",
    "Cfar",
    "Chain",
    "Chirp",
    "Cloud",
    "CosinePattern",
    "Ddma",
    "DechirpError",
    "Design",
    "Device",
    "Ego",
    "Engine",
    "Finding",
    "Frame",
    "Hardware",
    "Inspection",
    "InvalidFile",
    "InvalidSetting",
    "NotEnoughMemory",
    "Oscillation",
    "PatchArray",
    "PhaseCode",
    "PhysicsWarning",
    "Points",
    "Radar",
    "RcsTable",
    "Recording",
    "RecordingError",
    "Requirements",
    "Result",
    "Rotation",
    "Scatterer",
    "Scenario",
    "Scene",
    "Source",
    "TablePattern",
    "Target",
    "Tdm",
    "ThermalNoise",
    "Waypoint",
    "WhiteNoise",
    "design",
    "detect",
    "device",
    "inspect",
    "load",
    "open",
    "plan",
    "power_map",
    "reference",
    "run",
    "simulate",
    "threshold_map",
    "ti_cfg_text",
    "truth",
    "verify",
]


def __getattr__(name: str) -> object:
    if name not in _MODULE:
        raise AttributeError(f"module 'dechirp' has no attribute {name!r}")
    return getattr(importlib.import_module(f"dechirp.{_MODULE[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
