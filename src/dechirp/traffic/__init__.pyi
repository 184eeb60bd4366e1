# Written by tests/test_api.py.

from dechirp.experiments.scenario import traffic_scenario as traffic_scenario
from dechirp.traffic.common_road import CommonRoad as CommonRoad
from dechirp.traffic.frame_scenes import FrameScenes as FrameScenes
from dechirp.traffic.osi_export import sensor_views as sensor_views
from dechirp.traffic.osi_trace import OsiTrace as OsiTrace
from dechirp.traffic.source import TrafficSource as TrafficSource
from dechirp.traffic.trajectory_csv import TrajectoryCsv as TrajectoryCsv
from dechirp.traffic.true_objects import find_true_objects as find_true_objects
