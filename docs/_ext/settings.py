"""Settings of the guide: shown, and loaded by the package when the guide is built.

    ```{settings}
    chain:
      angle: {kind: music}
    ```

A wrong name is a warning, which `-W` makes an error. What a fragment leaves out is that of the
reference scenario, or of `examples/mimo.yaml` where only an array can do it, or of the file that
`over` names; a fragment of a study or a search is given a scenario and scores.
"""

import warnings
from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from scratch import folder_of
from sphinx.application import Sphinx
from sphinx.directives.code import container_wrapper
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from dechirp.config import loading
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import YamlNode, parse_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import READERS, Scenario
from dechirp.experiments.study.parsing import load_study
from dechirp.experiments.tune.parsing import load_tune
from dechirp.radar.design.requirements import Requirements
from dechirp.radar.radar import Radar

_REFERENCE = Path(str(resources.files("dechirp.experiments"))) / "reference.yaml"
_LOG = logging.getLogger(__name__)
_EXAMPLES = Path(__file__).parents[2] / "examples"
_REST: dict[str, dict[str, str]] = {
    "study": {"scenario": f"{_REFERENCE}", "scores": "[detection_probability]"},
    "tune": {
        "scenarios": f"[{_REFERENCE}]",
        "search": "{chain.cfar.n_guard.range: [3, 4]}",
        "objective": "{maximise: detection_probability}",
    },
    "requirements": {
        "max_range": "200 m",
        "range_resolution": "1 m",
        "max_velocity": "100 m/s",
    },
}


class Settings(SphinxDirective):
    """A settings file, or a part of one."""

    has_content = True
    option_spec = {  # noqa: RUF012
        "of": lambda text: directives.choice(text, tuple(_LOADED)),
        "over": directives.unchanged_required,
        "name": directives.unchanged_required,
        "whole": directives.flag,
    }
    """`of`: what they are settings of, a scenario without it. `over`: scenario that a fragment is
    laid over. `whole`: nothing is left out. `name`: file that they are written to, whole, for the
    blocks that follow."""

    def run(self) -> list[nodes.Node]:
        """Load them; the block as it is written."""
        text = "\n".join(self.content)
        folder = folder_of(self.env.app, self.env.docname)
        name = self.options.get("name", "")
        file = folder / (name or "settings.yaml")
        file.write_text(text + "\n", encoding="utf-8")
        try:
            self._load(file, folder)
        except DechirpError as error:
            _LOG.warning("%s\n%s", error, text, location=self.get_location(), type="guide")
        block = nodes.literal_block(text, text, language="yaml", classes=["settings"])
        if name:
            return [container_wrapper(self, block, f"`{name}`")]
        file.unlink()
        return [block]

    def _load(self, file: Path, folder: Path) -> None:
        """Load them over the first of the scenarios that they can be laid over."""
        load = _LOADED[self.options.get("of", "scenario")]
        bases: list[Path | None] = [_REFERENCE, _EXAMPLES / "mimo.yaml"]
        if "over" in self.options:
            bases = [folder / self.options["over"]]
        if "whole" in self.options or "name" in self.options:
            bases = [None]
        refused: list[DechirpError] = []
        for base in bases:
            try:
                with chdir(folder), warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # findings, which a run of them would tell
                    return load(file, base)
            except DechirpError as error:
                refused.append(error)
        raise refused[0]


def _scenario(file: Path, base: Path | None) -> None:
    _load(file, base, Scenario)


def _radar(file: Path, base: Path | None) -> None:
    _load(file, base, Radar)


def _load(file: Path, base: Path | None, kind: type) -> None:
    given = parse_yaml(file.read_text(encoding="utf-8"), file.name)
    if base is not None:
        under = parse_yaml(base.read_text(encoding="utf-8"), base.name)
        if kind is Radar and isinstance(under.content, dict):
            under = under.content.get("radar", under)
        given = _laid(_without_what_it_replaces(under, given), given)
    loading.build_value_from_tree(
        given, kind, ValidationContext(folder=file.parent, readers=READERS)
    )


def _without_what_it_replaces(under: YamlNode, given: YamlNode) -> YamlNode:
    """Leave out what goes with a scene where another is given, or a recording."""
    assert isinstance(under.content, dict)
    assert isinstance(given.content, dict)
    gone: set[str] = set()
    if "recording" in given.content:
        gone = {"scene", "radar", "impairments", "engine", "n_frames"}
    elif "scene" in given.content:
        gone = {"scene", "impairments"}  # noise may be set beside a target by name
    left = {name: node for name, node in under.content.items() if name not in gone}
    return replace(under, content=left)


def _laid(under: YamlNode, over: YamlNode) -> YamlNode:
    """Settings over others; a member of a family of another kind brings all of its own."""
    if not (isinstance(under.content, dict) and isinstance(over.content, dict)):
        return over
    if "kind" in over.content:
        return over
    laid = {
        name: _laid(under.content[name], node) if name in under.content else node
        for name, node in over.content.items()
    }
    return replace(over, content={**under.content, **laid})


def _study(file: Path, base: Path | None) -> None:
    _with_the_rest(file, base, "study", load_study)


def _tune(file: Path, base: Path | None) -> None:
    _with_the_rest(file, base, "tune", load_tune)


def _requirements(file: Path, base: Path | None) -> None:
    _with_the_rest(
        file, base, "requirements", lambda path: loading.read_settings(path, Requirements)
    )


def _with_the_rest(
    file: Path, base: Path | None, kind: str, load: Callable[[Path], object]
) -> None:
    text = file.read_text(encoding="utf-8")
    if base is None:
        load(file)
        return
    content = parse_yaml(text, file.name).content
    assert isinstance(content, dict)
    rest = dict(_REST[kind])
    if base != _REFERENCE and "scenario" in rest:
        rest["scenario"] = str(base)
    if "recordings" in content:
        rest.pop("scenarios", None)
    if base != _REFERENCE and "scenarios" in rest:
        rest["scenarios"] = f"[{base}]"
    lines = [f"{name}: {value}" for name, value in rest.items() if name not in content]
    filled = file.with_name("filled.yaml")
    filled.write_text("\n".join([text, *lines, ""]), encoding="utf-8")
    load(filled)
    filled.unlink()


_LOADED: dict[str, Callable[[Path, Path | None], None]] = {
    "scenario": _scenario,
    "study": _study,
    "tune": _tune,
    "radar": _radar,
    "requirements": _requirements,
}


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.setup_extension("scratch")
    app.add_directive("settings", Settings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
