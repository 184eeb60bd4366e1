"""Known chips and boards: what each allows, and where its antennas are."""

from dechirp.radar.devices.known import device as device
