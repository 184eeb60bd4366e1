"""Axis labels of all figures: one spelling of each quantity, and units in round brackets."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import dechirp
from nightly import nightly

TOP = Path(dechirp.__file__).parents[2]

# Files that draw figures, or prepare them for the report or the studio.
DRAWING_FILE = re.compile(r"matplotlib|bokeh|dechirp[./](report|studio)\b")
# Methods and keywords of Matplotlib and Bokeh that take axis labels.
LABEL_METHODS = {"set_xlabel", "set_ylabel", "set_zlabel", "supxlabel", "supylabel"}
LABEL_KEYWORDS = {"xlabel", "ylabel", "zlabel", "x_axis_label", "y_axis_label"}
COLOUR_BAR_KEYWORDS = {"colorbar": "label", "ColorBar": "title"}

# Different wordings of one quantity, with the wording by which they are compared.
EQUIVALENT_WORDINGS = {
    r"signal-to-noise ratio": "snr",
    r"signal-to-quantisation-noise ratio": "sqnr",
    r"false alarm": "false-alarm",
    r"rms(.*) error": r"rmse\1",
    r"(largest|max)\b": "maximum",
    r"mean noise": "noise",
}
FILL_WORDS = {"a", "the", "its", "of", "in", "per", "over", "to", "at"}
UNUSUAL_UNIT = re.compile(r"\b(deg|degrees|us|um|sec|mps|kmh|sqrt)\b|\^")


class Source(NamedTuple):
    """Parsed Python code, and the file that contains it."""

    path: str
    tree: ast.Module


class Name(NamedTuple):
    """Parameter, field or variable whose values are axis labels."""

    owner: str
    """Function, class, or scope of a variable; empty for constants."""
    name: str


class AxisLabel(NamedTuple):
    """Parts of an axis label: `name (unit, remark)`."""

    name: str
    unit: str
    remark: str

    @classmethod
    def parse(cls, text: str) -> "AxisLabel":
        match = re.fullmatch(r"(.*?)\s*\((.*)\)", text, re.DOTALL)
        if match is None:
            return cls(text, "", "")
        unit, _, remark = match[2].partition(", ")
        return cls(match[1], unit, remark)

    @property
    def quantity(self) -> frozenset[str]:
        """Words of the name, independent of their order and of common wordings."""
        words = self.name.lower()
        for wording, common in EQUIVALENT_WORDINGS.items():
            words = re.sub(rf"\b{wording}", common, words)
        return frozenset(words.split()) - FILL_WORDS


@cache
def parse_sources() -> tuple[Source, ...]:
    """Parse the files of the package that draw figures, the gallery, and the documentation."""
    sources = []
    for folder in ("src/dechirp", "docs", "examples"):
        for path in sorted((TOP / folder).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if DRAWING_FILE.search(f"{path.as_posix()}\n{text}"):
                sources.append(Source(path.relative_to(TOP).as_posix(), ast.parse(text)))
    for path in sorted((TOP / "docs").rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        blocks = re.findall(
            r"^```\{code-cell\} python\n(?:---\n.*?^---\n|(?::[^\n]*\n)*)(.*?)^```",
            text,
            re.DOTALL | re.MULTILINE,
        )
        sources += [Source(path.relative_to(TOP).as_posix(), ast.parse(code)) for code in blocks]
    return tuple(sources)


class LabelFinder(ast.NodeVisitor):
    """Collect the literal axis labels of a file, and the names that are passed on as labels."""

    def __init__(self, source: Source, label_names: set[Name], signatures: dict[str, list[str]]):
        self.path = source.path
        self.label_names = label_names
        self.signatures = signatures
        self.texts: set[str] = set()
        self.found_names: set[Name] = set()
        self._functions: list[tuple[str, dict[str, str]]] = []
        self._classes: list[ast.ClassDef] = []
        self._colour_bars = {
            target.id
            for node in ast.walk(source.tree)
            if isinstance(node, ast.Assign) and _called_name(node.value) == "colorbar"
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        self.visit(source.tree)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._classes.append(node)
        self.generic_visit(node)
        self._classes.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        name = self._classes[-1].name if node.name == "__init__" else node.name
        arguments = (*node.args.args, *node.args.kwonlyargs)
        classes = {item.arg: _last_name(item.annotation) for item in arguments}
        self._functions.append((name, classes))
        self.generic_visit(node)
        self._functions.pop()

    def visit_Call(self, node: ast.Call) -> None:
        name = _called_name(node)
        called = [name]
        if name == "__init__" and self._classes:
            called = [_last_name(base) for base in self._classes[-1].bases]
        if name in LABEL_METHODS:
            self._trace(node.args[0])
        if name == "set_label" and _last_name(node.func.value) in self._colour_bars:
            self._trace(node.args[0])
        for keyword in node.keywords:
            if (
                keyword.arg in LABEL_KEYWORDS
                or keyword.arg == COLOUR_BAR_KEYWORDS.get(name, "")
                or any(Name(owner, keyword.arg or "") in self.label_names for owner in called)
            ):
                self._trace(keyword.value)
        for owner in called:
            for parameter, value in zip(self.signatures.get(owner, ()), node.args, strict=False):
                if Name(owner, parameter) in self.label_names:
                    self._trace(value)
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            if ast.unparse(target).endswith((".axis_label", "colour_bar.title")):
                self._trace(node.value)
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            for name, value in zip(names, values, strict=False):
                self._trace_variable(name, value)
        self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._trace_variable(node.target, node.value)
        self.generic_visit(node)

    def visit_For(self, node: ast.For) -> None:
        loop_names = [name.id for name in ast.walk(node.target) if isinstance(name, ast.Name)]
        if any(Name(self._scope, name) in self.label_names for name in loop_names):
            self.texts |= {
                item.value
                for item in ast.walk(node.iter)
                if isinstance(item, ast.Constant) and re.search(r" \(.+\)$", str(item.value))
            }
        self.generic_visit(node)

    def _trace_variable(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Name) and {
            Name("", target.id), Name(self._scope, target.id),
        } & self.label_names:  # fmt: skip
            self._trace(value)

    def _trace(self, value: ast.expr) -> None:
        """Record a literal label, or the name that holds it."""
        match value:
            case ast.Constant(value=str(text)):
                self.texts.add(text)
            case ast.JoinedStr(values=parts):
                self.texts.add("".join(getattr(part, "value", None) if isinstance(part, ast.Constant) else "{}" for part in parts))  # fmt: skip  # noqa: E501
            case ast.IfExp(body=body, orelse=other):
                self._trace(body)
                self._trace(other)
            case ast.Dict(values=values) | ast.Tuple(elts=values):
                for item in values:
                    self._trace(item)
            case ast.Subscript(slice=ast.Constant(value=str(field))) if field.endswith("label"):
                self._record_field(field)
            case ast.Subscript(value=inner):
                self._trace(inner)
            case ast.Call(func=ast.Attribute(value=inner, attr="replace")):
                self._trace(inner)
            case ast.Attribute(value=ast.Name(id=name), attr=field):
                self._record_attribute(name, field)
            case ast.Name(id=name):
                self._record_variable(name)

    def _record_attribute(self, name: str, field: str) -> None:
        if field.isupper():
            self.found_names.add(Name("", field))
        self.found_names |= {
            Name(classes[name], field) for _, classes in self._functions if name in classes
        }

    def _record_variable(self, name: str) -> None:
        owners = [function for function, classes in self._functions if name in classes]
        self.found_names.add(
            Name("", name) if name.isupper() else Name((owners or [self._scope])[-1], name)
        )

    @property
    def _scope(self) -> str:
        classes = (node.name for node in self._classes)
        functions = (function for function, _ in self._functions)
        return ":".join([self.path, *classes, *functions])

    def _record_field(self, field: str) -> None:
        self.found_names |= {
            Name(owner, field) for owner, names in self.signatures.items() if field in names
        }


def _last_name(node: ast.expr | None) -> str:
    return getattr(node, "id", getattr(node, "attr", ""))


def _called_name(node: ast.expr) -> str:
    return _last_name(node.func) if isinstance(node, ast.Call) else ""


def _parameters(node: ast.FunctionDef) -> list[str]:
    names = [item.arg for item in (*node.args.posonlyargs, *node.args.args)]
    return [name for name in names if name != "self"] + [item.arg for item in node.args.kwonlyargs]


def collect_signatures(sources: Iterable[Source]) -> dict[str, list[str]]:
    """Return the parameters of each function and class, including the fields of dataclasses."""
    signatures: dict[str, list[str]] = defaultdict(list)
    for source in sources:
        for node in ast.walk(source.tree):
            if isinstance(node, ast.FunctionDef) and node.name != "__init__":
                signatures[node.name] += _parameters(node)
            elif isinstance(node, ast.ClassDef):
                for item in node.body:
                    if isinstance(item, ast.AnnAssign):
                        signatures[node.name].append(_last_name(item.target))
                    elif isinstance(item, ast.FunctionDef) and item.name == "__init__":
                        signatures[node.name] += _parameters(item)
    return dict(signatures)


def find_axis_labels(sources: tuple[Source, ...]) -> dict[str, set[str]]:
    """Find the literal axis labels and the files that contain them; {} is a computed part.

    Parameters, fields and variables that are passed on as labels are followed to their values.
    """
    signatures = collect_signatures(sources)
    label_names: set[Name] = set()
    while True:
        finders = [LabelFinder(source, label_names, signatures) for source in sources]
        found_names = label_names.union(*(finder.found_names for finder in finders))
        if found_names == label_names:
            break
        label_names = found_names
    paths = defaultdict(set)
    for finder in finders:
        for text in finder.texts - {""}:
            paths[text].add(finder.path)
    return dict(paths)


def iter_labels_with_misplaced_unit(texts: Iterable[str]) -> Iterator[str]:
    """Yield the labels with a unit that is not in round brackets, or with an unusual unit."""
    units = {AxisLabel.parse(text).unit for text in texts} - {""}
    units |= {unit.removesuffix("s") for unit in units & {"cells", "bins", "cycles"}}
    alternatives = "|".join(map(re.escape, units | {"{}", "deg", "degrees"}))
    # Numbers with units and counted things are part of the name: "power at 5 m/s".
    unit_at_end = re.compile(
        rf"(, ?| / ?|\[|\bin )({alternatives})\]?$|(?<!\d)(?<!\bof)(?<!\bper) ({alternatives})$"
    )
    for text in texts:
        label = AxisLabel.parse(text)
        name = re.sub(r"^Number of .*", "", label.name)
        if unit_at_end.search(name) or UNUSUAL_UNIT.search(label.unit):
            yield text


def group_spellings(texts: Iterable[str]) -> list[set[str]]:
    """Return the sets of labels that name one quantity, or its sign, in different ways."""
    labels = defaultdict(list)
    for text in texts:
        label = AxisLabel.parse(text)
        labels[label.quantity].append((text, label.name, label.remark))
    return [
        {text for text, _, _ in group}
        for group in labels.values()
        if len({(name, remark) for _, name, remark in group}) > 1
    ]


@pytest.fixture(scope="module")
def label_paths() -> dict[str, set[str]]:
    return find_axis_labels(parse_sources())


@nightly
def test_axis_labels_have_units_in_round_brackets(label_paths):
    misplaced = list(iter_labels_with_misplaced_unit(label_paths))

    assert {text: label_paths[text] for text in misplaced} == {}


@nightly
def test_each_quantity_has_one_spelling(label_paths):
    # Tiles of 160 pixels have no room for the words.
    groups = group_spellings(label_paths.keys() - {"Velocity (m/s, + receding)"})

    assert [{text: label_paths[text] for text in group} for group in groups] == []


@nightly
def test_labels_are_found_in_all_kinds_of_sources(label_paths):
    folders = {re.match(r"src/dechirp/\w+|docs/gallery|docs|examples", path)[0]
               for paths in label_paths.values() for path in paths}  # fmt: skip

    assert {"src/dechirp/report", "src/dechirp/studio", "docs/gallery", "docs"} <= folders
    assert "src/dechirp/report/labels.py" in label_paths["Range (m)"]
    assert "src/dechirp/certificate/detection_curves.py" in label_paths["Separation (range bins)"]
    assert "src/dechirp/studio/views/beat.py" in label_paths["Amplitude ({})"]
    assert len(label_paths) > 80


def test_labels_are_followed_through_parameters_and_fields():
    code = """
LABELS = {"range": "Range (m)"}
class View:
    def __init__(self, x): self.figure = figure(x_axis_label=x)
class Wide(View):
    def __init__(self): super().__init__(x="Azimuth (°)")
@dataclass
class Axis:
    text: str
def draw(axes, label, axis: Axis):
    axes.set_xlabel(label)
    axes.set_ylabel(axis.text)
    bar = axes.figure.colorbar(image)
    bar.set_label(f"Power ({unit})")
    axes.set_label("Map of the power")
draw(axes, LABELS["range"], Axis(text="Time (s)"))
"""
    assert set(find_axis_labels((Source("a.py", ast.parse(code)),))) == {
        "Range (m)",
        "Azimuth (°)",
        "Time (s)",
        "Power ({})",
    }


@pytest.mark.parametrize(
    "text",
    [
        "Azimuth (deg)",
        "Azimuth, deg",
        "Range [m]",
        "Range in m",
        "Range / m",
        "Range cell",
        "v (us)",
    ],
)
def test_unit_outside_of_round_brackets_is_found(text):
    assert list(iter_labels_with_misplaced_unit([text, "Range (m)", "Offset (cells)"])) == [text]


@pytest.mark.parametrize(
    "texts",
    [
        {"Detection probability", "Probability of detection"},
        {"SNR per sample (dB)", "Signal-to-noise ratio in a sample (dB)"},
        {"Azimuth RMSE (°)", "RMS azimuth error (mrad)"},
        {"Velocity (m/s)", "Velocity (m/s, receding positive)"},
        {"Power over noise (dB)", "Power over the mean noise (dB)"},
    ],
)
def test_two_spellings_are_found(texts):
    assert group_spellings({*texts, "Range (m)", "Range (cells)"}) == [texts]
