# Written by tests/test_api.py.

from dechirp.evaluation.gospa import gospa as gospa
from dechirp.evaluation.identity import track_identities as track_identities
from dechirp.evaluation.nees import mean_nees_interval as mean_nees_interval
from dechirp.evaluation.nees import nees as nees
from dechirp.evaluation.ospa import ospa_m as ospa_m
from dechirp.evaluation.track_trial import TrackTrial as TrackTrial
from dechirp.evaluation.track_trial import assess_track_completeness as assess_track_completeness
from dechirp.evaluation.track_trial import draw_truth_and_detections as draw_truth_and_detections
