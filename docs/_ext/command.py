"""Directive `command`: shell commands of the guide, run during the build, with their output.

    ```{command}
    :lines: 6
    dechirp run examples/mimo.yaml
    ```

The blocks of a page run in order in its scratch folder, so that later blocks can read the files of
earlier ones. An exit status other than `status` is a warning, which `-W` makes an error.
sphinxcontrib-programoutput runs all commands of a page after its cells, which need their files.
"""

import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from scratch import folder_of
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

_COLUMNS = 76
_LONGEST_S = 120
# `dechirp` and `python` of the environment that builds the guide, activated or not.
_PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
_LOG = logging.getLogger(__name__)


class Command(SphinxDirective):
    """A block of shell commands."""

    has_content = True
    option_spec = {  # noqa: RUF012
        "lines": directives.nonnegative_int,
        "status": directives.nonnegative_int,
        "ran": directives.unchanged,
    }
    """`lines`: number of output lines shown, from the end, 12 by default. `status`: expected
    exit status, 0 by default. `ran`: command that is run instead, e.g. with fewer trials."""

    def run(self) -> list[nodes.Node]:
        """Run the command; return a block with its text and one with its output."""
        typed = "\n".join(self.content)
        process = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", self.options.get("ran", typed)],
            cwd=folder_of(self.env.app, self.env.docname),
            env={
                **os.environ,
                "PATH": _PATH,
                "COLUMNS": str(_COLUMNS),
                "NO_COLOR": "1",
                "MPLBACKEND": "agg",
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=_LONGEST_S,
            check=False,
        )
        if process.returncode != self.options.get("status", 0):
            _LOG.warning(
                "ended with %s\n%s\n%s",
                process.returncode,
                typed,
                process.stdout,
                location=self.get_location(),
                type="guide",
            )
        blocks: list[nodes.Node] = [
            nodes.literal_block(typed, typed, language="bash", classes=["typed"])
        ]
        # Terminals wrap the text of findings; tables fit.
        printed = [
            part
            for line in process.stdout.rstrip().splitlines()
            for part in textwrap.wrap(
                line,
                _COLUMNS,
                break_long_words=False,
                break_on_hyphens=False,
                drop_whitespace=len(line) > _COLUMNS,
            )
            or [""]
        ]
        last_lines = printed[-self.options.get("lines", 12) :]
        if last_lines and self.options.get("lines") != 0:
            text = "\n".join(
                last_lines if len(last_lines) == len(printed) else ["...", *last_lines]
            )
            blocks.append(nodes.literal_block(text, text, language="text", classes=["printed"]))
        return blocks


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.setup_extension("scratch")
    app.add_directive("command", Command)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
