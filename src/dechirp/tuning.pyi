# Written by tests/test_api.py.

from dechirp.experiments.tune.tune import LabelledRecording as LabelledRecording
from dechirp.experiments.tune.tune import Limit as Limit
from dechirp.experiments.tune.tune import Objective as Objective
