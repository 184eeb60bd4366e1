"""Devices by name, however a file or a user spells it."""

import re

from dechirp.core.errors import InvalidSetting
from dechirp.radar.devices.base import Device

# Chips that differ only in what they compute share their first two digits: xWR18xx.
_TI_CHIP = re.compile(r"(?:a|i|x)?w?r?(12|14|16|18|29|68)(?:\d\d|xx|\dx)(?:boost|evm|isk)?")
_TI_KINDS = {
    "12": "xwr1443",
    "14": "xwr1443",
    "16": "xwr1642",
    "18": "xwr1843",
    "29": "xwr2944",
    "68": "xwr6843",
}
_OTHER_KINDS = {"mmwcas": "cascade", "mmwcasrfevm": "cascade", "bgt60tr13": "bgt60tr13c"}


def device(name: str) -> Device:
    """Device of that name: a kind, or a chip as its vendor, a file or a user spells it.

    Upper and lower case, hyphens and blanks do not count: AWR1843, xWR18xx, AR1642.

    Raises
    ------
    InvalidSetting
        If no such device is known; it names those that are.
    """
    plain = re.sub(r"[-_\s]", "", str(name)).lower()
    chip = _TI_CHIP.fullmatch(plain)
    kind = _TI_KINDS[chip.group(1)] if chip else _OTHER_KINDS.get(plain, plain)
    members = Device.members()
    if kind not in members:
        raise InvalidSetting(
            "device",
            got=name,
            need=f"one of {', '.join(members)}",
            fix="Boards with other antennas, such as AOP and ODS, are not among them: give the"
            " radar with its array.",
        )
    found: Device = members[kind]()
    return found
