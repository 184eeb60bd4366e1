"""What `design` takes for granted, beside the requirements."""

from dechirp.core.values import value
from dechirp.radar.design import TYPICAL_HARDWARE, TYPICAL_LIMITS
from dechirp.radar.hardware import Hardware
from dechirp.radar.requirements import Limits


@value
class Assumed:
    """What the parts do and allow: what `--set` may change."""

    limits: Limits = TYPICAL_LIMITS
    hardware: Hardware = TYPICAL_HARDWARE
