# Public names, which lazy_loader reads when the package is imported.

# Radar: waveform, antennas, hardware and their design
from .radar.chirp import Chirp as Chirp
from .radar.frame import Frame as Frame
from .radar.array import Array as Array
from .radar.hardware import Hardware as Hardware
from .radar.radar import Radar as Radar
from .radar.calibration import Calibration as Calibration
from .radar.design.requirements import Requirements as Requirements
from .radar.design.design import design as design
from .radar.devices.lookup import device as device
# Scene and simulation
from .scene.scene import Scene as Scene
from .scene.target import Target as Target
from .scene.ego import Ego as Ego
from .scene.waypoints import Waypoint as Waypoint
from .scene.truth import truth as truth
from .simulation.engine import Engine as Engine
from .simulation.simulate import simulate as simulate
# Recordings and live streams
from .recordings.recording import Recording as Recording
from .recordings.recording import open as open
from .recordings.in_memory import recording_from_cube as recording_from_cube
from .recordings.convert import write as write
from .recordings.live.udp import listen as listen
from .recordings.live.growing_file import follow as follow
from .recordings.live.replay import replay as replay
# Traffic of other simulators
from .traffic.traffic import open_traffic as open_traffic
from .traffic.mounting import Mounting as Mounting
# Processing: from samples to detections
from .processing.chain import Chain as Chain
from .processing.cfar.base import Cells as Cells
from .processing.cfar.base import Cfar as Cfar
from .processing.cluster import Dbscan as Dbscan
from .processing.cluster import cluster as cluster
from .processing.angle.aperture import FieldOfView as FieldOfView
from .processing.detect import detect as detect
from .processing.range_doppler_map import power_map as power_map
from .processing.range_doppler_map import threshold_map as threshold_map
from .processing.angle_maps import angle_spectrum as angle_spectrum
from .processing.angle_maps import range_azimuth_map as range_azimuth_map
from .processing.spectrogram import spectrogram as spectrogram
from .processing.ddma_recognition import recognise_ddma as recognise_ddma
from .processing.calibration.calibrate import calibrate as calibrate
# Tracking: from detections to objects
from .tracking.ego import EgoMotion as EgoMotion
from .tracking.ego import ego_motion as ego_motion
from .tracking.forward_speed import ForwardSpeed as ForwardSpeed
from .tracking.forward_speed import forward_speed as forward_speed
from .tracking.tracker import Tracker as Tracker
from .tracking.batch import track as track
from .tracking.online import LiveTracker as LiveTracker
from .results.object_lists.object_list import object_list as object_list
# Experiments
from .experiments.scenario import Scenario as Scenario
from .experiments.scenario import load as load
from .experiments.scenario import reference as reference
from .experiments.run import Result as Result
from .experiments.run import run as run
from .experiments.sensor_model import SensorModel as SensorModel
from .experiments.inspection import inspect as inspect
from .experiments.streaming import process_stream as process_stream
from .experiments.twin.twin import twin as twin
from .experiments.study.study import Study as Study
from .experiments.study.parsing import load_study as load_study
from .experiments.study.run import run_study as run_study
from .experiments.tune.tune import Tune as Tune
from .experiments.tune.parsing import load_tune as load_tune
from .experiments.tune.run import run_tune as run_tune
from .certificate.certificate import verify as verify
# Errors, warnings and findings
from .core.errors import DechirpError as DechirpError
from .core.errors import InvalidFile as InvalidFile
from .core.errors import InvalidSetting as InvalidSetting
from .core.errors import NotEnoughMemory as NotEnoughMemory
from .core.errors import RecordingError as RecordingError
from .core.findings import Finding as Finding
from .core.findings import PhysicsWarning as PhysicsWarning
# Namespaces of families: each member is a file of the package
from . import angle as angle
from . import bodies as bodies
from . import cfar as cfar
from . import devices as devices
from . import generators as generators
from . import impairments as impairments
from . import mitigation as mitigation
from . import modulations as modulations
from . import multiplexing as multiplexing
from . import patterns as patterns
from . import scores as scores
# Namespaces of settings of studies and searches
from . import studies as studies
from . import tuning as tuning
# Namespaces of functions
from . import diagnosis as diagnosis
from . import fixed_point as fixed_point
from . import fusion as fusion
from . import group_tracking as group_tracking
from . import link_budget as link_budget
from . import maps as maps
from . import object_lists as object_lists
from . import slow_time as slow_time
from . import slow_time_files as slow_time_files
from . import theory as theory
from . import track_metrics as track_metrics
from . import traffic as traffic
from . import vital_signs as vital_signs
from . import windows as windows
# Namespace of base classes, for packages that add members
from . import extensions as extensions

__version__: str
