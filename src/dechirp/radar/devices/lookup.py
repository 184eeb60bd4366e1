"""Device lookup by chip or board name, in any spelling of a file or a user."""

import re
from collections.abc import Callable

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.radar.devices.base import Device

# Chips that differ only in their processors share their first two digits: xWR18xx. The board
# follows where its antennas are not those of the chip's first one.
_TI_CHIP = re.compile(
    r"(?:a|i|x)?w?r?(12|14|16|18|22|29|64|68)(?:\d\d|xx|\dx)(?:boost|evm|isk)?(aop|ods)?(?:evmg?)?"
)
_TI_KINDS = {
    "12": "xwr1443",
    "14": "xwr1443",
    "16": "xwr1642",
    "18": "xwr1843",
    "22": "xwr2243",
    "29": "xwr2944",
    "64": "xwr6843",
    "68": "xwr6843",
}
# Names of boards with the antennas of another chip's.
_NAMES = {"12": "AWR1243BOOST"}
_ALIASES = {"mmwcas": "cascade", "mmwcasrfevm": "cascade", "bgt60tr13": "bgt60tr13c"}


@check_argument_types
def device(name: str) -> Device:
    """Return the device of a name: a kind, or a chip as its vendor, a file or a user spells it.

    Case, hyphens and blanks are ignored: AWR1843, xWR18xx, AR1642, xWR68xx_AOP.

    Raises
    ------
    InvalidSetting
        If no such device is known; the message lists the known ones.
    """
    normalised = re.sub(r"[-_\s]", "", str(name)).lower()
    chip = _TI_CHIP.fullmatch(normalised)
    kind = _TI_KINDS[chip[1]] + (chip[2] or "") if chip else _ALIASES.get(normalised, normalised)
    members = Device.members()
    if kind not in members:
        raise InvalidSetting(
            "device",
            value=name,
            expected=f"one of {', '.join(members)}",
            fix="for a board with other antennas, give the radar with its array",
        )
    build_device: Callable[..., Device] = members[kind]
    name_of_chip = _NAMES.get(chip[1]) if chip else None
    return build_device(name=name_of_chip) if name_of_chip else build_device()
