"""Cramer-Rao bounds of several sources from the tests of doatools."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.theory.source_bounds import SourceModel, crlb_directions
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

# The functions of doatools, in the order of its tests.
_MODELS: dict[str, SourceModel] = {
    "crb_det_farfield_1d": "deterministic",
    "crb_sto_farfield_1d": "stochastic",
    "crb_stouc_farfield_1d": "uncorrelated",
}


class DoatoolsBounds(Witness):
    """Bounds of three sources on ten elements; ours from the Fisher information, theirs closed."""

    folder: ClassVar[str] = "doatools_crb"
    source: ClassVar[str] = "morriswmz/doatools.py 9469db2, tests of Cramer-Rao bounds"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the elements of each matrix."""
        azimuth_rad = np.linspace(-np.pi / 3, np.pi / 4, 3)
        # doatools has the phase of the opposite sign.
        positions = -np.arange(10) / 2
        for model, sources, theirs in _read_cases((folder / "test_crb.txt").read_text()):
            ours = crlb_directions(positions, azimuth_rad, sources, 1.0, 100, model)
            for row in range(len(theirs)):
                yield compare_arrays(
                    f"{model} bound of 3 sources, row {row + 1}",
                    theirs[row],
                    ours[row],
                    unit="rad^2",
                    relative=1e-6,
                    basis="seven digits in the file, 1e-6",
                )


def _read_cases(program: str) -> Iterator[tuple[SourceModel, np.ndarray, np.ndarray]]:
    """Yield the model, the source covariance or powers, and the bound of each test."""
    for test in ast.walk(ast.parse(program)):
        if not isinstance(test, ast.FunctionDef):
            continue
        arrays = {
            target.id: np.array(_evaluate(statement.value.args[0]))
            for statement in test.body
            if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Call)
            for target in statement.targets
            if isinstance(target, ast.Name) and ast.unparse(statement.value.func) == "np.array"
        }
        called = {ast.unparse(node.func) for node in ast.walk(test) if isinstance(node, ast.Call)}
        if "CRB_expected" in arrays:
            (model,) = (_MODELS[name] for name in called if name in _MODELS)
            yield model, arrays["P" if "P" in arrays else "p"], arrays["CRB_expected"]


def _evaluate(node: ast.expr) -> list[complex]:
    return ast.literal_eval(node)
