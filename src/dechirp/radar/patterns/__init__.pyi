# Written by tests/test_api.py.

from dechirp.radar.patterns.cosine import CosinePattern as CosinePattern
from dechirp.radar.patterns.patch_array import PatchArray as PatchArray
from dechirp.radar.patterns.table import TablePattern as TablePattern
