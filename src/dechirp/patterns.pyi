# Written by tests/test_api.py.

from dechirp.radar.patterns.cosine import Cosine as Cosine
from dechirp.radar.patterns.patch_array import PatchArray as PatchArray
from dechirp.radar.patterns.table import Table as Table
