# Written by tests/test_api.py.

from dechirp.generators.c import C as C
from dechirp.generators.verilog import Verilog as Verilog
