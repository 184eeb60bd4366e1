"""Device lookup by chip or board name, in any spelling of a file or a user."""

import re

from dechirp.core.errors import InvalidSetting
from dechirp.radar.devices.base import Device

# Chips that differ only in their processors share their first two digits: xWR18xx.
_TI_CHIP = re.compile(r"(?:a|i|x)?w?r?(12|14|16|18|29|68)(?:\d\d|xx|\dx)(?:boost|evm|isk)?")
_TI_KINDS = {
    "12": "xwr1443",
    "14": "xwr1443",
    "16": "xwr1642",
    "18": "xwr1843",
    "29": "xwr2944",
    "68": "xwr6843",
}
_ALIASES = {"mmwcas": "cascade", "mmwcasrfevm": "cascade", "bgt60tr13": "bgt60tr13c"}


def device(name: str) -> Device:
    """Return the device of a name: a kind, or a chip as its vendor, a file or a user spells it.

    Case, hyphens and blanks are ignored: AWR1843, xWR18xx, AR1642.

    Raises
    ------
    InvalidSetting
        If no such device is known; the message lists the known ones.
    """
    normalised = re.sub(r"[-_\s]", "", str(name)).lower()
    chip = _TI_CHIP.fullmatch(normalised)
    kind = _TI_KINDS[chip.group(1)] if chip else _ALIASES.get(normalised, normalised)
    members = Device.members()
    if kind not in members:
        raise InvalidSetting(
            "device",
            value=name,
            expected=f"one of {', '.join(members)}",
            fix="boards with other antennas, such as AOP and ODS, are not among them: give the"
            " radar with its array",
        )
    instance: Device = members[kind]()
    return instance
