# Written by tests/test_api.py.

from dechirp.processing.vital_signs import VitalSigns as VitalSigns
from dechirp.processing.vital_signs import chest_displacement as chest_displacement
from dechirp.processing.vital_signs import measure_vital_signs as measure_vital_signs
