# Written by tests/test_api.py.

from dechirp.evaluation.score.clusters import ClustersPerTarget as ClustersPerTarget
from dechirp.evaluation.score.clusters import OneClusterProbability as OneClusterProbability
from dechirp.evaluation.score.errors import AzimuthBias as AzimuthBias
from dechirp.evaluation.score.errors import AzimuthRmse as AzimuthRmse
from dechirp.evaluation.score.errors import ElevationBias as ElevationBias
from dechirp.evaluation.score.errors import ElevationRmse as ElevationRmse
from dechirp.evaluation.score.errors import RangeBias as RangeBias
from dechirp.evaluation.score.errors import RangeRmse as RangeRmse
from dechirp.evaluation.score.errors import VelocityBias as VelocityBias
from dechirp.evaluation.score.errors import VelocityRmse as VelocityRmse
from dechirp.evaluation.score.probabilities import DetectionProbability as DetectionProbability
from dechirp.evaluation.score.probabilities import FalseAlarmProbability as FalseAlarmProbability
from dechirp.evaluation.score.probabilities import FrameFalseAlarmProbability as FrameFalseAlarmProbability
from dechirp.evaluation.score.probabilities import ResolutionProbability as ResolutionProbability
from dechirp.evaluation.score.processing_time import ProcessingTime as ProcessingTime
from dechirp.evaluation.score.roc import Roc as Roc
from dechirp.evaluation.score.tracks import FalseTracks as FalseTracks
from dechirp.evaluation.score.tracks import IdentitySwitches as IdentitySwitches
from dechirp.evaluation.score.tracks import TrackCompleteness as TrackCompleteness
from dechirp.evaluation.score.tracks import TrackGospa as TrackGospa
from dechirp.evaluation.score.tracks import TrackNees as TrackNees
from dechirp.evaluation.score.tracks import TrackOspa as TrackOspa
