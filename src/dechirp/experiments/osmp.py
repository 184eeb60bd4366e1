"""OSI Sensor Model Packaging (OSMP): OSI messages through the integers of an FMU of FMI 2.

A binary variable is three integers: both halves of the address of a buffer, and its size. A buffer
of the output stays valid until the second step after its own.

References
----------
ASAM OSI, OSI Sensor Model Packaging 1.5.0. Functional Mock-up Interface 2.0.4.
"""

import ctypes
import json
from collections import deque
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, register_namespace

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.experiments.scenario import load
from dechirp.experiments.sensor_model import SensorModel
from dechirp.results.object_lists.osi import osi_version
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.osi_views import view_time_s

SETTINGS_NAME, OPTIONS_NAME = "settings.yaml", "options.json"
"""Files in the resources of an FMU: scenario, and the other arguments of its sensor model."""

_VERSION = "1.5.0"
_NAMESPACE = "http://xsd.pmsf.net/OSISensorModelPackaging"
_TOOL = "net.pmsf.osmp"
_ROLES = ("base.lo", "base.hi", "size")
_MESSAGES = {"OSMPSensorViewIn": "SensorView", "OSMPSensorDataOut": "SensorData"}
_LOW_32_BITS = 0xFFFFFFFF
_ROUNDING_S = 1e-6  # of times in communication steps


class BinaryVariable:
    """Buffer as three signed integers of 32 bits, see `_ROLES`; all 0 while there is none."""

    def __init__(self) -> None:
        self.integers = dict.fromkeys(_ROLES, 0)
        self._buffers: deque[Any] = deque(maxlen=2)

    def read(self) -> bytes | None:
        """Return a copy of the bytes at the address that was set, None if there is no buffer."""
        high, low = (self.integers[role] & _LOW_32_BITS for role in ("base.hi", "base.lo"))
        address, size = high << 32 | low, self.integers["size"]
        return ctypes.string_at(address, size) if address and size > 0 else None

    def write(self, content: bytes) -> None:
        """Copy bytes to a buffer, and keep it and the one before."""
        buffer = ctypes.create_string_buffer(content, len(content))
        self._buffers.append(buffer)
        address = ctypes.addressof(buffer)
        self.integers = {
            "base.lo": ctypes.c_int32(address & _LOW_32_BITS).value,
            "base.hi": ctypes.c_int32(address >> 32).value,
            "size": len(content),
        }


class OsmpRadar:
    """Sensor model between the binary variables of an FMU, from the files in its resources."""

    def __init__(self, resources: Path) -> None:
        scenario = load(resources / SETTINGS_NAME)
        options = json.loads((resources / OPTIONS_NAME).read_text(encoding="utf-8"))
        if isinstance(options["mount"], dict):
            options["mount"] = Mounting(**options["mount"])
        self._model = SensorModel(scenario, **options)
        self._n_logged_findings = 0
        self._last_s: float | None = None
        self.variables = {name: BinaryVariable() for name in _MESSAGES}
        """Input and output by their names in OSMP."""

    @property
    def period_s(self) -> float:
        """Time from frame to frame."""
        frame = self._model.radar.frame
        return frame.frame_start_s(1) - frame.frame_start_s(0)

    def step(self) -> tuple[Finding, ...]:
        """Measure the view at the input if a frame is due; return new findings.

        A simulator that steps faster than the radar gets the data of the last frame.

        Raises
        ------
        InvalidSetting
            As `SensorModel.step`.
        """
        content = self.variables["OSMPSensorViewIn"].read()
        if content is None or not self._is_due(content):
            return ()
        data = self._model.step(content)
        self._last_s = view_time_s(content)
        self.variables["OSMPSensorDataOut"].write(data.SerializeToString())
        findings = self._model.findings[self._n_logged_findings :]
        self._n_logged_findings = len(self._model.findings)
        return findings

    def _is_due(self, content: bytes) -> bool:
        """Return False for a view before the end of the period; views that go back are due."""
        if self._last_s is None:
            return True
        try:
            now_s = view_time_s(content)
        except InvalidSetting:
            return True  # the step states what is wrong
        return not self._last_s <= now_s < self._last_s + self.period_s - _ROUNDING_S


def annotate_model_description(root: Element) -> Element:
    """Add the annotations of OSMP to a model description of FMI 2 and return it."""
    register_namespace("osmp", _NAMESPACE)
    version = osi_version()
    vendor = Element("VendorAnnotations")
    tool = SubElement(vendor, "Tool", name=_TOOL)
    SubElement(tool, f"{{{_NAMESPACE}}}osmp", {"version": _VERSION, "osi-version": version})
    place = [child.tag for child in root].index("ModelVariables")
    root.insert(place, vendor)
    for variable in root.iter("ScalarVariable"):
        name, _, role = variable.get("name", "").partition(".")
        tool = SubElement(SubElement(variable, "Annotations"), "Tool", name=_TOOL)
        attributes = {
            "name": name,
            "role": role,
            "mime-type": "application/x-open-simulation-interface;"
            f" type={_MESSAGES[name]}; version={version}",
        }
        SubElement(tool, f"{{{_NAMESPACE}}}osmp-binary-variable", attributes)
    return root
