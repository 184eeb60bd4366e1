"""Design, simulate, process and verify FMCW radars, on simulated and recorded data alike.

    import dechirp as dc

    radar = dc.design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100).radar
    scene = dc.Scene(targets=[dc.Target(position_m=(50, 0, 0), rcs_m2=10)])
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)

Names are loaded on first use, so importing the package loads no library for numbers. Families and
other groups are modules: `dc.cfar.CellAveraging`, or `from dechirp.cfar import CellAveraging`.
"""

import logging

from lazy_loader import attach_stub

# Applications choose handlers; without any, nothing is printed.
logging.getLogger(__name__).addHandler(logging.NullHandler())

__version__ = "0.1.0"

# The names are in `__init__.pyi`.
__getattr__, _, __all__ = attach_stub(__name__, __file__)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
