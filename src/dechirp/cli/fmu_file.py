"""Functional mock-up unit (FMI 2) of a radar, by the OSI Sensor Model Packaging convention."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import dechirp
from dechirp.config.dumping import dump_yaml
from dechirp.core.argument_types import check_argument_types
from dechirp.core.atomic_files import atomic_output_file, check_file_suffix
from dechirp.core.optional_imports import import_from_extra
from dechirp.experiments.osmp import OPTIONS_NAME, SETTINGS_NAME
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.sensor_model import (
    Kind,
    SensorModel,
    mount_of_traffic,
    settings_without_scene,
)
from dechirp.results.object_lists.osi import osi_version
from dechirp.traffic.mounting import Mounting

REQUIREMENT = f"dechirp[io,track]=={dechirp.__version__}"
"""Requirement of the Python that runs the FMU."""

_MODULE = "dechirp_radar"
# PythonFMU runs this file in the FMU; the resources also contain its own modules.
_SCRIPT = f'''"""Radar of dechirp in an FMU; its Python needs {REQUIREMENT}."""

import atexit
import ctypes
from pathlib import Path

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer
from pythonfmu.enums import Fmi2Initial, Fmi2Status

try:
    from dechirp.core.errors import DechirpError
    from dechirp.experiments.osmp import OsmpRadar, annotate_model_description
except ImportError as error:
    raise RuntimeError("this FMU needs {REQUIREMENT} in the Python that runs it") from error


class DechirpRadar(Fmi2Slave):
    author = "dechirp {dechirp.__version__}"
    description = "FMCW radar: OSI SensorView in, SensorData out; needs Python with {REQUIREMENT}"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        resources = Path(self.resources)
        self.radar = OsmpRadar(resources)
        for library in resources.parent.glob("binaries/linux64/*.so"):
            # At the end of a process on Linux, PythonFMU 0.7.0 would release its interpreter twice.
            atexit.register(ctypes.CDLL(str(library)).finalizePythonInterpreter)
        self.default_experiment = DefaultExperiment(0.0, None, self.radar.period_s)
        for name, variable in self.radar.variables.items():
            self._register(name, variable, is_input=name.endswith("In"))

    def _register(self, name, variable, is_input):
        for role in variable.integers:
            self.register_variable(
                Integer(
                    f"{{name}}.{{role}}",
                    causality=Fmi2Causality.input if is_input else Fmi2Causality.output,
                    variability=Fmi2Variability.discrete,
                    initial=None if is_input else Fmi2Initial.exact,
                    getter=lambda role=role: variable.integers[role],
                    setter=lambda value, role=role: variable.integers.update({{role: value}}),
                ),
                nested=False,
            )

    def to_xml(self, model_options=dict()):
        return annotate_model_description(super().to_xml(model_options))

    def do_step(self, current_time, step_size):
        try:
            for finding in self.radar.step():
                is_note = finding.level == "note"
                self.log(str(finding), Fmi2Status.ok if is_note else Fmi2Status.warning)
        except DechirpError as error:
            self.log(str(error), Fmi2Status.error)
            return False
        return True
'''


@check_argument_types
def write_fmu(
    scenario: Scenario,
    path: str | Path,
    *,
    mount: str | None = None,
    kind: Kind = "samples",
    seed: int | None = None,
) -> None:
    """Pack the radar of a scenario as an FMU for co-simulation, atomically.

    Input `OSMPSensorViewIn`, output `OSMPSensorDataOut`, each as three integers. The FMU contains
    settings and the libraries of PythonFMU for Linux and Windows (x86-64); the Python that runs it
    needs `REQUIREMENT`.

    Parameters
    ----------
    scenario, mount, kind, seed
        As of `SensorModel`.
    path : path
        `.fmu`; an existing file is replaced.

    Raises
    ------
    InvalidSetting
        If the sensor model cannot be built, the path cannot be written, or an extra is missing.
    """
    file = check_file_suffix(path, (".fmu",))
    builder = import_from_extra("fmu", "pythonfmu.builder", setting="fmu").FmuBuilder
    SensorModel(scenario, mount=mount, kind=kind, seed=seed)  # raises for settings that do not fit
    osi_version()  # raises without the extra io
    place = mount or mount_of_traffic(scenario)
    pose = asdict(place) if isinstance(place, Mounting) else place
    options = {"mount": pose, "kind": kind, "seed": seed}
    with TemporaryDirectory() as name, _import_path_restored():
        folder = Path(name)
        files = {
            f"{_MODULE}.py": _SCRIPT,
            SETTINGS_NAME: dump_yaml(settings_without_scene(scenario)),
            OPTIONS_NAME: json.dumps(options),
            "requirements.txt": REQUIREMENT + "\n",
        }
        for file_name, content in files.items():
            (folder / file_name).write_text(content, encoding="utf-8")
        built = builder.build_FMU(
            folder / f"{_MODULE}.py",
            dest=folder / "radar.fmu",
            project_files=[folder / file_name for file_name in list(files)[1:]],
        )
        with atomic_output_file(file) as temporary:
            temporary.write_bytes(Path(built).read_bytes())


@contextmanager
def _import_path_restored() -> Iterator[None]:
    """Restore the import path and forget the module, which PythonFMU adds."""
    folders = list(sys.path)
    try:
        yield
    finally:
        sys.path[:] = folders
        sys.modules.pop(_MODULE, None)
