# Written by tests/test_api.py.

from dechirp.theory.windows import bin_correlation as bin_correlation
from dechirp.theory.windows import chebyshev_weights as chebyshev_weights
from dechirp.theory.windows import coherent_gain as coherent_gain
from dechirp.theory.windows import half_main_lobe_bins as half_main_lobe_bins
from dechirp.theory.windows import kaiser_weights as kaiser_weights
from dechirp.theory.windows import noise_bandwidth_bins as noise_bandwidth_bins
from dechirp.theory.windows import scalloping_loss as scalloping_loss
from dechirp.theory.windows import taylor_weights as taylor_weights
from dechirp.theory.windows import window_names as window_names
from dechirp.theory.windows import window_weights as window_weights
