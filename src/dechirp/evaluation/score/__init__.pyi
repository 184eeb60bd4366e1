# Written by tests/test_api.py.

from dechirp.evaluation.score.clusters_per_target import ClustersPerTarget as ClustersPerTarget
from dechirp.evaluation.score.detection_probability import DetectionProbability as DetectionProbability
from dechirp.evaluation.score.errors import AzimuthBias as AzimuthBias
from dechirp.evaluation.score.errors import AzimuthRmse as AzimuthRmse
from dechirp.evaluation.score.errors import ElevationBias as ElevationBias
from dechirp.evaluation.score.errors import ElevationRmse as ElevationRmse
from dechirp.evaluation.score.errors import RangeBias as RangeBias
from dechirp.evaluation.score.errors import RangeRmse as RangeRmse
from dechirp.evaluation.score.errors import VelocityBias as VelocityBias
from dechirp.evaluation.score.errors import VelocityRmse as VelocityRmse
from dechirp.evaluation.score.false_alarm_probability import FalseAlarmProbability as FalseAlarmProbability
from dechirp.evaluation.score.false_tracks import FalseTracks as FalseTracks
from dechirp.evaluation.score.frame_false_alarm_probability import FrameFalseAlarmProbability as FrameFalseAlarmProbability
from dechirp.evaluation.score.identity_switches import IdentitySwitches as IdentitySwitches
from dechirp.evaluation.score.one_cluster_probability import OneClusterProbability as OneClusterProbability
from dechirp.evaluation.score.processing_time import ProcessingTime as ProcessingTime
from dechirp.evaluation.score.resolution_probability import ResolutionProbability as ResolutionProbability
from dechirp.evaluation.score.roc import Roc as Roc
from dechirp.evaluation.score.track_completeness import TrackCompleteness as TrackCompleteness
from dechirp.evaluation.score.track_gospa import TrackGospa as TrackGospa
from dechirp.evaluation.score.track_nees import TrackNees as TrackNees
from dechirp.evaluation.score.track_ospa import TrackOspa as TrackOspa
