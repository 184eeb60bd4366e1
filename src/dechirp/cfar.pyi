# Written by tests/test_api.py.

from dechirp.processing.cfar.cell_averaging import CellAveraging as CellAveraging
from dechirp.processing.cfar.cell_averaging import GreatestOf as GreatestOf
from dechirp.processing.cfar.cell_averaging import SmallestOf as SmallestOf
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic as OrderedStatistic
from dechirp.processing.cfar.plain_arrays import cfar_threshold as cfar_threshold
from dechirp.processing.cfar.plain_arrays import find_peaks as find_peaks
from dechirp.processing.cfar.trimmed_mean import TrimmedMean as TrimmedMean
from dechirp.processing.cfar.two_step import TwoStep as TwoStep
