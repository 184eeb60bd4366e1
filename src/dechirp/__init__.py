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
    from dechirp.echoes.codes import codes
    from dechirp.echoes.echo import plan, simulate
    from dechirp.echoes.engine import Engine
    from dechirp.echoes.impairments.bumper import Bumper
    from dechirp.echoes.impairments.coloured_noise import ColouredNoise
    from dechirp.echoes.impairments.compression import Compression
    from dechirp.echoes.impairments.coupling import Coupling
    from dechirp.echoes.impairments.dc_offset import DcOffset
    from dechirp.echoes.impairments.fog import Fog
    from dechirp.echoes.impairments.gas import Gas
    from dechirp.echoes.impairments.ground import Ground
    from dechirp.echoes.impairments.if_filter import IfFilter
    from dechirp.echoes.impairments.interference import Interference, Interferer
    from dechirp.echoes.impairments.iq_imbalance import IqImbalance
    from dechirp.echoes.impairments.jitter import Jitter
    from dechirp.echoes.impairments.leakage import Leakage
    from dechirp.echoes.impairments.mismatch import Mismatch
    from dechirp.echoes.impairments.phase_noise import PhaseNoise
    from dechirp.echoes.impairments.pll import Pll
    from dechirp.echoes.impairments.polynomial_nonlinearity import PolynomialNonlinearity
    from dechirp.echoes.impairments.position_errors import PositionErrors
    from dechirp.echoes.impairments.quantisation import Quantisation
    from dechirp.echoes.impairments.radome import Radome
    from dechirp.echoes.impairments.rain import Rain
    from dechirp.echoes.impairments.rain_backscatter import RainBackscatter
    from dechirp.echoes.impairments.sinusoidal_nonlinearity import SinusoidalNonlinearity
    from dechirp.echoes.impairments.slope_drift import SlopeDrift
    from dechirp.echoes.impairments.thermal_noise import ThermalNoise
    from dechirp.echoes.impairments.typical_77ghz import Typical77Ghz
    from dechirp.echoes.impairments.wall import Wall
    from dechirp.echoes.impairments.white_noise import WhiteNoise
    from dechirp.evaluate.gospa import gospa
    from dechirp.evaluate.identity import identities
    from dechirp.evaluate.nees import mean_nees_interval, nees
    from dechirp.evaluate.ospa import ospa_m
    from dechirp.evaluate.score.azimuth_bias import AzimuthBias
    from dechirp.evaluate.score.azimuth_rmse import AzimuthRmse
    from dechirp.evaluate.score.clusters_per_target import ClustersPerTarget
    from dechirp.evaluate.score.detection_probability import DetectionProbability
    from dechirp.evaluate.score.elevation_bias import ElevationBias
    from dechirp.evaluate.score.elevation_rmse import ElevationRmse
    from dechirp.evaluate.score.false_alarm_probability import FalseAlarmProbability
    from dechirp.evaluate.score.false_tracks import FalseTracks
    from dechirp.evaluate.score.frame_false_alarm_probability import FrameFalseAlarmProbability
    from dechirp.evaluate.score.one_cluster_probability import OneClusterProbability
    from dechirp.evaluate.score.processing_time import ProcessingTime
    from dechirp.evaluate.score.range_bias import RangeBias
    from dechirp.evaluate.score.range_rmse import RangeRmse
    from dechirp.evaluate.score.resolution_probability import ResolutionProbability
    from dechirp.evaluate.score.roc import Roc
    from dechirp.evaluate.score.track_gospa import TrackGospa
    from dechirp.evaluate.score.track_held import TrackHeld
    from dechirp.evaluate.score.track_identity_changes import TrackIdentityChanges
    from dechirp.evaluate.score.track_nees import TrackNees
    from dechirp.evaluate.score.track_ospa import TrackOspa
    from dechirp.evaluate.score.velocity_bias import VelocityBias
    from dechirp.evaluate.score.velocity_rmse import VelocityRmse
    from dechirp.exchange.convert import write
    from dechirp.exchange.in_memory import recording_of
    from dechirp.experiment.inspection import Inspection, inspect
    from dechirp.experiment.run import Result, run
    from dechirp.experiment.scenario import Scenario, Source, load, reference
    from dechirp.experiment.statistical.sensor import Sensor, sense
    from dechirp.experiment.study.read import load_study
    from dechirp.experiment.study.run import Finished, run_study
    from dechirp.experiment.study.study import (
        Draw,
        Drawn,
        Listed,
        Requirement,
        Study,
        Trials,
        Until,
    )
    from dechirp.experiment.tune.read import load_tune
    from dechirp.experiment.tune.run import run_tune
    from dechirp.experiment.tune.tune import Aim, Limit, Recorded, Tune
    from dechirp.experiment.twin.twin import Twin, TwinBar, twin
    from dechirp.experiment.verify.certificate import Certificate, verify
    from dechirp.experiment.watch import stream_of, watch
    from dechirp.formats.recording import Recording, open
    from dechirp.formats.settings.write_ti_cfg import ti_cfg_text
    from dechirp.live.follow import Growing, follow
    from dechirp.live.replay import replay
    from dechirp.live.stream import Stream
    from dechirp.live.udp import Listener, listen
    from dechirp.objects.files import read_objects, write_objects
    from dechirp.objects.object_list import object_list
    from dechirp.process.angle.aperture import FieldOfView
    from dechirp.process.angle.bartlett import Bartlett
    from dechirp.process.angle.capon import Capon
    from dechirp.process.angle.esprit import Esprit
    from dechirp.process.angle.fft import Fft
    from dechirp.process.angle.iterative_adaptive import IterativeAdaptive
    from dechirp.process.angle.maximum_likelihood import MaximumLikelihood
    from dechirp.process.angle.monopulse import Monopulse
    from dechirp.process.angle.music import Music
    from dechirp.process.angle.root_music import RootMusic
    from dechirp.process.angle_maps import angle_spectrum, range_azimuth_map
    from dechirp.process.calibration.calibrate import Calibrated, calibrate
    from dechirp.process.cfar.base import Cells, Cfar
    from dechirp.process.cfar.cell_averaging import CellAveraging
    from dechirp.process.cfar.greatest_of import GreatestOf
    from dechirp.process.cfar.ordered_statistic import OrderedStatistic
    from dechirp.process.cfar.smallest_of import SmallestOf
    from dechirp.process.cfar.trimmed_mean import TrimmedMean
    from dechirp.process.cfar.two_step import TwoStep
    from dechirp.process.chain import Chain
    from dechirp.process.cluster import Dbscan, Reach, cluster
    from dechirp.process.detect import detect
    from dechirp.process.fixed_point.agreement import agreement, agreement_over_bits
    from dechirp.process.fixed_point.chain import fixed_point_map
    from dechirp.process.fixed_point.noise import ratios_over_bits
    from dechirp.process.fixed_point.words import WordLengths
    from dechirp.process.maps import power_map, threshold_map
    from dechirp.process.mitigation.interference_autoregression import InterferenceAutoregression
    from dechirp.process.mitigation.interference_zeroing import InterferenceZeroing
    from dechirp.process.mitigation.leakage_subtraction import LeakageSubtraction
    from dechirp.process.mitigation.mean_subtraction import MeanSubtraction
    from dechirp.process.mitigation.moving_target_indication import MovingTargetIndication
    from dechirp.process.slow_time import (
        by_frame,
        displacement,
        displacement_spectrum,
        range_track,
        slow_time,
        strongest_line,
    )
    from dechirp.process.spectrogram import spectrogram
    from dechirp.radar.array import Array
    from dechirp.radar.calibration import Calibration
    from dechirp.radar.chirp import Chirp
    from dechirp.radar.design import Design, design
    from dechirp.radar.devices.base import Device
    from dechirp.radar.devices.known import device
    from dechirp.radar.frame import Frame
    from dechirp.radar.hardware import Hardware
    from dechirp.radar.modulations.frequency_shift_keying import FrequencyShiftKeying
    from dechirp.radar.modulations.staggered import Staggered
    from dechirp.radar.modulations.triangular import Triangular
    from dechirp.radar.multiplexing.bpm import Bpm
    from dechirp.radar.multiplexing.ddma import Ddma
    from dechirp.radar.multiplexing.phase_code import PhaseCode
    from dechirp.radar.multiplexing.tdm import Tdm
    from dechirp.radar.patterns.cosine import CosinePattern
    from dechirp.radar.patterns.patch_array import PatchArray
    from dechirp.radar.patterns.table import TablePattern
    from dechirp.radar.radar import Radar
    from dechirp.radar.requirements import Requirements
    from dechirp.scene.bodies.bicyclist import Bicyclist
    from dechirp.scene.bodies.car import Car
    from dechirp.scene.bodies.cloud import Cloud
    from dechirp.scene.bodies.corner_reflector import CornerReflector
    from dechirp.scene.bodies.ground_clutter import GroundClutter
    from dechirp.scene.bodies.guard_rail import GuardRail
    from dechirp.scene.bodies.mesh import Mesh
    from dechirp.scene.bodies.pedestrian import Pedestrian
    from dechirp.scene.bodies.plate import Plate
    from dechirp.scene.bodies.points import Oscillation, Points, Rotation, Scatterer
    from dechirp.scene.bodies.sphere import Sphere
    from dechirp.scene.bodies.truck import Truck
    from dechirp.scene.bodies.van import Van
    from dechirp.scene.ego import Ego
    from dechirp.scene.rays import Rays
    from dechirp.scene.rcs_table import RcsTable
    from dechirp.scene.scene import Scene
    from dechirp.scene.target import Target
    from dechirp.scene.truth import truth
    from dechirp.scene.waypoints import Waypoint
    from dechirp.store.hex_vectors import read_vectors, read_words, write_vectors
    from dechirp.tracking.ego import EgoMotion, ego_motion, labelled
    from dechirp.tracking.false_alarms import FalseAlarms
    from dechirp.tracking.live import LiveTracker
    from dechirp.tracking.mounting import mounting
    from dechirp.tracking.tracker import Tracker
    from dechirp.tracking.tracks import track

_WHERE = {
    "core.errors": "DechirpError InvalidFile InvalidSetting NotEnoughMemory RecordingError",
    "core.findings": "Finding PhysicsWarning",
    "echoes.codes": "codes",
    "echoes.echo": "plan simulate",
    "echoes.engine": "Engine",
    "echoes.impairments.bumper": "Bumper",
    "echoes.impairments.coloured_noise": "ColouredNoise",
    "echoes.impairments.compression": "Compression",
    "echoes.impairments.coupling": "Coupling",
    "echoes.impairments.dc_offset": "DcOffset",
    "echoes.impairments.fog": "Fog",
    "echoes.impairments.gas": "Gas",
    "echoes.impairments.ground": "Ground",
    "echoes.impairments.if_filter": "IfFilter",
    "echoes.impairments.interference": "Interference Interferer",
    "echoes.impairments.iq_imbalance": "IqImbalance",
    "echoes.impairments.jitter": "Jitter",
    "echoes.impairments.leakage": "Leakage",
    "echoes.impairments.mismatch": "Mismatch",
    "echoes.impairments.phase_noise": "PhaseNoise",
    "echoes.impairments.pll": "Pll",
    "echoes.impairments.polynomial_nonlinearity": "PolynomialNonlinearity",
    "echoes.impairments.position_errors": "PositionErrors",
    "echoes.impairments.quantisation": "Quantisation",
    "echoes.impairments.radome": "Radome",
    "echoes.impairments.rain": "Rain",
    "echoes.impairments.rain_backscatter": "RainBackscatter",
    "echoes.impairments.sinusoidal_nonlinearity": "SinusoidalNonlinearity",
    "echoes.impairments.slope_drift": "SlopeDrift",
    "echoes.impairments.thermal_noise": "ThermalNoise",
    "echoes.impairments.typical_77ghz": "Typical77Ghz",
    "echoes.impairments.wall": "Wall",
    "echoes.impairments.white_noise": "WhiteNoise",
    "evaluate.gospa": "gospa",
    "evaluate.identity": "identities",
    "evaluate.nees": "mean_nees_interval nees",
    "evaluate.ospa": "ospa_m",
    "evaluate.score.azimuth_bias": "AzimuthBias",
    "evaluate.score.azimuth_rmse": "AzimuthRmse",
    "evaluate.score.clusters_per_target": "ClustersPerTarget",
    "evaluate.score.detection_probability": "DetectionProbability",
    "evaluate.score.elevation_bias": "ElevationBias",
    "evaluate.score.elevation_rmse": "ElevationRmse",
    "evaluate.score.false_alarm_probability": "FalseAlarmProbability",
    "evaluate.score.false_tracks": "FalseTracks",
    "evaluate.score.frame_false_alarm_probability": "FrameFalseAlarmProbability",
    "evaluate.score.one_cluster_probability": "OneClusterProbability",
    "evaluate.score.processing_time": "ProcessingTime",
    "evaluate.score.range_bias": "RangeBias",
    "evaluate.score.range_rmse": "RangeRmse",
    "evaluate.score.resolution_probability": "ResolutionProbability",
    "evaluate.score.roc": "Roc",
    "evaluate.score.track_gospa": "TrackGospa",
    "evaluate.score.track_held": "TrackHeld",
    "evaluate.score.track_identity_changes": "TrackIdentityChanges",
    "evaluate.score.track_nees": "TrackNees",
    "evaluate.score.track_ospa": "TrackOspa",
    "evaluate.score.velocity_bias": "VelocityBias",
    "evaluate.score.velocity_rmse": "VelocityRmse",
    "exchange.convert": "write",
    "exchange.in_memory": "recording_of",
    "experiment.inspection": "Inspection inspect",
    "experiment.run": "Result run",
    "experiment.scenario": "Scenario Source load reference",
    "experiment.statistical.sensor": "Sensor sense",
    "experiment.study.read": "load_study",
    "experiment.study.run": "Finished run_study",
    "experiment.study.study": "Draw Drawn Listed Requirement Study Trials Until",
    "experiment.tune.read": "load_tune",
    "experiment.tune.run": "run_tune",
    "experiment.tune.tune": "Aim Limit Recorded Tune",
    "experiment.twin.twin": "Twin TwinBar twin",
    "experiment.verify.certificate": "Certificate verify",
    "experiment.watch": "stream_of watch",
    "formats.recording": "Recording open",
    "formats.settings.write_ti_cfg": "ti_cfg_text",
    "live.follow": "Growing follow",
    "live.replay": "replay",
    "live.stream": "Stream",
    "live.udp": "Listener listen",
    "objects.files": "read_objects write_objects",
    "objects.object_list": "object_list",
    "process.angle.aperture": "FieldOfView",
    "process.angle.bartlett": "Bartlett",
    "process.angle.capon": "Capon",
    "process.angle.esprit": "Esprit",
    "process.angle.fft": "Fft",
    "process.angle.iterative_adaptive": "IterativeAdaptive",
    "process.angle.maximum_likelihood": "MaximumLikelihood",
    "process.angle.monopulse": "Monopulse",
    "process.angle.music": "Music",
    "process.angle.root_music": "RootMusic",
    "process.angle_maps": "angle_spectrum range_azimuth_map",
    "process.calibration.calibrate": "Calibrated calibrate",
    "process.cfar.base": "Cells Cfar",
    "process.cfar.cell_averaging": "CellAveraging",
    "process.cfar.greatest_of": "GreatestOf",
    "process.cfar.ordered_statistic": "OrderedStatistic",
    "process.cfar.smallest_of": "SmallestOf",
    "process.cfar.trimmed_mean": "TrimmedMean",
    "process.cfar.two_step": "TwoStep",
    "process.chain": "Chain",
    "process.cluster": "Dbscan Reach cluster",
    "process.detect": "detect",
    "process.fixed_point.agreement": "agreement agreement_over_bits",
    "process.fixed_point.chain": "fixed_point_map",
    "process.fixed_point.noise": "ratios_over_bits",
    "process.fixed_point.words": "WordLengths",
    "process.maps": "power_map threshold_map",
    "process.mitigation.interference_autoregression": "InterferenceAutoregression",
    "process.mitigation.interference_zeroing": "InterferenceZeroing",
    "process.mitigation.leakage_subtraction": "LeakageSubtraction",
    "process.mitigation.mean_subtraction": "MeanSubtraction",
    "process.mitigation.moving_target_indication": "MovingTargetIndication",
    "process.slow_time": "by_frame displacement displacement_spectrum range_track slow_time"
    " strongest_line",
    "process.spectrogram": "spectrogram",
    "radar.array": "Array",
    "radar.calibration": "Calibration",
    "radar.chirp": "Chirp",
    "radar.design": "Design design",
    "radar.devices.base": "Device",
    "radar.devices.known": "device",
    "radar.frame": "Frame",
    "radar.hardware": "Hardware",
    "radar.modulations.frequency_shift_keying": "FrequencyShiftKeying",
    "radar.modulations.staggered": "Staggered",
    "radar.modulations.triangular": "Triangular",
    "radar.multiplexing.bpm": "Bpm",
    "radar.multiplexing.ddma": "Ddma",
    "radar.multiplexing.phase_code": "PhaseCode",
    "radar.multiplexing.tdm": "Tdm",
    "radar.patterns.cosine": "CosinePattern",
    "radar.patterns.patch_array": "PatchArray",
    "radar.patterns.table": "TablePattern",
    "radar.radar": "Radar",
    "radar.requirements": "Requirements",
    "scene.bodies.bicyclist": "Bicyclist",
    "scene.bodies.car": "Car",
    "scene.bodies.cloud": "Cloud",
    "scene.bodies.corner_reflector": "CornerReflector",
    "scene.bodies.ground_clutter": "GroundClutter",
    "scene.bodies.guard_rail": "GuardRail",
    "scene.bodies.mesh": "Mesh",
    "scene.bodies.pedestrian": "Pedestrian",
    "scene.bodies.plate": "Plate",
    "scene.bodies.points": "Oscillation Points Rotation Scatterer",
    "scene.bodies.sphere": "Sphere",
    "scene.bodies.truck": "Truck",
    "scene.bodies.van": "Van",
    "scene.ego": "Ego",
    "scene.rays": "Rays",
    "scene.rcs_table": "RcsTable",
    "scene.scene": "Scene",
    "scene.target": "Target",
    "scene.truth": "truth",
    "scene.waypoints": "Waypoint",
    "store.hex_vectors": "read_vectors read_words write_vectors",
    "tracking.ego": "EgoMotion ego_motion labelled",
    "tracking.false_alarms": "FalseAlarms",
    "tracking.live": "LiveTracker",
    "tracking.mounting": "mounting",
    "tracking.tracker": "Tracker",
    "tracking.tracks": "track",
}
_MODULE = {name: module for module, names in _WHERE.items() for name in names.split()}

__all__ = [
    "Aim",
    "Array",
    "AzimuthBias",
    "AzimuthRmse",
    "Bartlett",
    "Bicyclist",
    "Bpm",
    "Bumper",
    "Calibrated",
    "Calibration",
    "Capon",
    "Car",
    "CellAveraging",
    "Cells",
    "Certificate",
    "Cfar",
    "Chain",
    "Chirp",
    "Cloud",
    "ClustersPerTarget",
    "ColouredNoise",
    "Compression",
    "CornerReflector",
    "CosinePattern",
    "Coupling",
    "Dbscan",
    "DcOffset",
    "Ddma",
    "DechirpError",
    "Design",
    "DetectionProbability",
    "Device",
    "Draw",
    "Drawn",
    "Ego",
    "EgoMotion",
    "ElevationBias",
    "ElevationRmse",
    "Engine",
    "Esprit",
    "FalseAlarmProbability",
    "FalseAlarms",
    "FalseTracks",
    "Fft",
    "FieldOfView",
    "Finding",
    "Finished",
    "Fog",
    "Frame",
    "FrameFalseAlarmProbability",
    "FrequencyShiftKeying",
    "Gas",
    "GreatestOf",
    "Ground",
    "GroundClutter",
    "Growing",
    "GuardRail",
    "Hardware",
    "IfFilter",
    "Inspection",
    "Interference",
    "InterferenceAutoregression",
    "InterferenceZeroing",
    "Interferer",
    "InvalidFile",
    "InvalidSetting",
    "IqImbalance",
    "IterativeAdaptive",
    "Jitter",
    "Leakage",
    "LeakageSubtraction",
    "Limit",
    "Listed",
    "Listener",
    "LiveTracker",
    "MaximumLikelihood",
    "MeanSubtraction",
    "Mesh",
    "Mismatch",
    "Monopulse",
    "MovingTargetIndication",
    "Music",
    "NotEnoughMemory",
    "OneClusterProbability",
    "OrderedStatistic",
    "Oscillation",
    "PatchArray",
    "Pedestrian",
    "PhaseCode",
    "PhaseNoise",
    "PhysicsWarning",
    "Plate",
    "Pll",
    "Points",
    "PolynomialNonlinearity",
    "PositionErrors",
    "ProcessingTime",
    "Quantisation",
    "Radar",
    "Radome",
    "Rain",
    "RainBackscatter",
    "RangeBias",
    "RangeRmse",
    "Rays",
    "RcsTable",
    "Reach",
    "Recorded",
    "Recording",
    "RecordingError",
    "Requirement",
    "Requirements",
    "ResolutionProbability",
    "Result",
    "Roc",
    "RootMusic",
    "Rotation",
    "Scatterer",
    "Scenario",
    "Scene",
    "Sensor",
    "SinusoidalNonlinearity",
    "SlopeDrift",
    "SmallestOf",
    "Source",
    "Sphere",
    "Staggered",
    "Stream",
    "Study",
    "TablePattern",
    "Target",
    "Tdm",
    "ThermalNoise",
    "TrackGospa",
    "TrackHeld",
    "TrackIdentityChanges",
    "TrackNees",
    "TrackOspa",
    "Tracker",
    "Trials",
    "Triangular",
    "TrimmedMean",
    "Truck",
    "Tune",
    "Twin",
    "TwinBar",
    "TwoStep",
    "Typical77Ghz",
    "Until",
    "Van",
    "VelocityBias",
    "VelocityRmse",
    "Wall",
    "Waypoint",
    "WhiteNoise",
    "WordLengths",
    "agreement",
    "agreement_over_bits",
    "angle_spectrum",
    "by_frame",
    "calibrate",
    "cluster",
    "codes",
    "design",
    "detect",
    "device",
    "displacement",
    "displacement_spectrum",
    "ego_motion",
    "fixed_point_map",
    "follow",
    "gospa",
    "identities",
    "inspect",
    "labelled",
    "listen",
    "load",
    "load_study",
    "load_tune",
    "mean_nees_interval",
    "mounting",
    "nees",
    "object_list",
    "open",
    "ospa_m",
    "plan",
    "power_map",
    "range_azimuth_map",
    "range_track",
    "ratios_over_bits",
    "read_objects",
    "read_vectors",
    "read_words",
    "recording_of",
    "reference",
    "replay",
    "run",
    "run_study",
    "run_tune",
    "sense",
    "simulate",
    "slow_time",
    "spectrogram",
    "stream_of",
    "strongest_line",
    "threshold_map",
    "ti_cfg_text",
    "track",
    "truth",
    "twin",
    "verify",
    "watch",
    "write",
    "write_objects",
    "write_vectors",
]


def __getattr__(name: str) -> object:
    if name not in _MODULE:
        raise AttributeError(f"module 'dechirp' has no attribute {name!r}")
    return getattr(importlib.import_module(f"dechirp.{_MODULE[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
