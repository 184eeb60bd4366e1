# Written by tests/test_api.py.

from dechirp.processing.diagnosis.diagnose import diagnose_map as diagnose_map
from dechirp.processing.diagnosis.diagnose import diagnose_samples as diagnose_samples
from dechirp.processing.diagnosis.diagnose import diagnose_threshold as diagnose_threshold
from dechirp.processing.diagnosis.diagnosis import Diagnosis as Diagnosis
