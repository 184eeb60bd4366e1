"""Settings of `dechirp design` beside the requirements."""

from dechirp.core.values import frozen_dataclass
from dechirp.radar.design.design import TYPICAL_HARDWARE, TYPICAL_LIMITS
from dechirp.radar.design.requirements import Limits
from dechirp.radar.hardware import Hardware


@frozen_dataclass
class DesignAssumptions:
    """Limits and hardware of a design, both changed by `--set`."""

    limits: Limits = TYPICAL_LIMITS
    hardware: Hardware = TYPICAL_HARDWARE
