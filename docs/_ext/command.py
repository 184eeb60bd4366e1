"""Commands of the guide: shown, run when the guide is built, and followed by what they print.

    ```{command}
    :lines: 6
    dechirp run examples/mimo.yaml
    ```

The blocks of a page run one after the other in its scratch folder; what one writes the next one
reads. A command that ends otherwise than `status` says is a warning, which `-W` makes an error.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from scratch import folder_of
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

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
    """`lines`: so many of the last ones are shown, 12 without it. `status`: that it ends with, 0
    without it. `ran`: what is run in its place, with fewer trials."""

    def run(self) -> list[nodes.Node]:
        """Run it; a block of what was typed, and one of what came out."""
        typed = "\n".join(self.content)
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", self.options.get("ran", typed)],
            cwd=folder_of(self.env.app, self.env.docname),
            env={
                **os.environ,
                "PATH": _PATH,
                "COLUMNS": "76",
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
        if done.returncode != self.options.get("status", 0):
            _LOG.warning(
                "ended with %s\n%s\n%s",
                done.returncode,
                typed,
                done.stdout,
                location=self.get_location(),
                type="guide",
            )
        shown: list[nodes.Node] = [
            nodes.literal_block(typed, typed, language="bash", classes=["typed"])
        ]
        printed = done.stdout.rstrip().splitlines()
        kept = printed[-self.options.get("lines", 12) :]
        if kept and self.options.get("lines") != 0:
            text = "\n".join(kept if len(kept) == len(printed) else ["...", *kept])
            shown.append(nodes.literal_block(text, text, language="text", classes=["printed"]))
        return shown


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.setup_extension("scratch")
    app.add_directive("command", Command)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
