"""Design, simulate, process and verify FMCW radars, on simulated and recorded data alike.

    import dechirp as dc

    radar = dc.design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100).radar
    scene = dc.Scene(targets=[dc.Target(position_m=(50, 0, 0), rcs_m2=10)])
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)

Names are loaded on first use, so importing the package loads no other library. Families and
other groups are modules: `dc.cfar.CellAveraging`, or `from dechirp.cfar import CellAveraging`.
"""

import importlib
import logging

# Applications choose handlers; without any, nothing is printed.
logging.getLogger(__name__).addHandler(logging.NullHandler())

__version__ = "0.1.0"

_NAMES = {
    # Radar: waveform, antennas, hardware and their design
    "radar.chirp": "Chirp",
    "radar.frame": "Frame",
    "radar.array": "Array",
    "radar.hardware": "Hardware",
    "radar.radar": "Radar",
    "radar.calibration": "Calibration",
    "radar.design.requirements": "Requirements",
    "radar.design.design": "design",
    "radar.devices.lookup": "device",
    # Scene and simulation
    "scene.scene": "Scene",
    "scene.target": "Target",
    "scene.ego": "Ego",
    "scene.waypoints": "Waypoint",
    "scene.truth": "truth",
    "simulation.engine": "Engine",
    "simulation.simulate": "simulate",
    # Recordings and live streams
    "recordings.recording": "Recording open",
    "recordings.in_memory": "recording_from_cube",
    "recordings.convert": "write",
    "recordings.live.udp": "listen",
    "recordings.live.growing_file": "follow",
    "recordings.live.replay": "replay",
    # Traffic of other simulators
    "traffic.traffic": "open_traffic",
    "traffic.mounting": "Mounting",
    # Processing: from samples to detections
    "processing.chain": "Chain",
    "processing.cfar.base": "Cells Cfar",
    "processing.cluster": "Dbscan cluster",
    "processing.angle.aperture": "FieldOfView",
    "processing.detect": "detect",
    "processing.range_doppler_map": "power_map threshold_map",
    "processing.angle_maps": "angle_spectrum range_azimuth_map",
    "processing.spectrogram": "spectrogram",
    "processing.ddma_recognition": "recognise_ddma",
    "processing.calibration.calibrate": "calibrate",
    # Tracking: from detections to objects
    "tracking.ego": "EgoMotion ego_motion",
    "tracking.forward_speed": "ForwardSpeed forward_speed",
    "tracking.tracker": "Tracker",
    "tracking.batch": "track",
    "tracking.online": "LiveTracker",
    "results.object_lists.object_list": "object_list",
    # Experiments
    "experiments.scenario": "Scenario load reference",
    "experiments.run": "Result run",
    "experiments.sensor_model": "SensorModel",
    "experiments.inspection": "inspect",
    "experiments.streaming": "process_stream",
    "experiments.twin.twin": "twin",
    "experiments.study.study": "Study",
    "experiments.study.parsing": "load_study",
    "experiments.study.run": "run_study",
    "experiments.tune.tune": "Tune",
    "experiments.tune.parsing": "load_tune",
    "experiments.tune.run": "run_tune",
    "certificate.certificate": "verify",
    # Errors, warnings and findings
    "core.errors": "DechirpError InvalidFile InvalidSetting NotEnoughMemory RecordingError",
    "core.findings": "Finding PhysicsWarning",
}
"""Names by the module that defines them."""

_NAMESPACES = (
    # Families: each member is a file of the package
    *("angle", "bodies", "cfar", "devices", "generators", "impairments", "mitigation"),
    *("modulations", "multiplexing", "patterns", "scores"),
    # Settings of studies and searches
    *("studies", "tuning"),
    # Functions
    *(
        "diagnosis",
        "fixed_point",
        "fusion",
        "group_tracking",
        "link_budget",
        "maps",
        "object_lists",
    ),
    *(
        "slow_time",
        "slow_time_files",
        "theory",
        "track_metrics",
        "traffic",
        "vital_signs",
        "windows",
    ),
    # Base classes, for packages that add members
    "extensions",
)
"""Modules of public names: `dechirp.cfar` and so on."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    if name in _NAMESPACES:
        return importlib.import_module(f"dechirp.{name}")
    if name in _MODULES:
        return getattr(importlib.import_module(f"dechirp.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'dechirp' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, *_NAMESPACES, "__version__"]
