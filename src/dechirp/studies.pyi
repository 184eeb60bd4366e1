# Written by tests/test_api.py.

from dechirp.experiments.statistical.sensor import draw_statistical_detections as draw_statistical_detections
from dechirp.experiments.study.study import RandomSetting as RandomSetting
from dechirp.experiments.study.study import Requirement as Requirement
from dechirp.experiments.study.study import Sampling as Sampling
from dechirp.experiments.study.study import StopRule as StopRule
from dechirp.experiments.study.study import SweptSetting as SweptSetting
from dechirp.experiments.study.study import TrialBudget as TrialBudget
