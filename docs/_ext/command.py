"""Directive `command`: shell commands of the guide, run during the build, with their output.

    ```{command}
    :ellipsis: 0, -6
    dechirp run examples/mimo.yaml
    ```

It is the directive of sphinxcontrib-programoutput for commands that later blocks of the page build
on: they run at once, in the scratch folder of the page. An exit status other than `returncode` is
a warning, which `-W` makes an error.
"""

import os
import shlex
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from scratch import folder_of
from sphinx.application import Sphinx
from sphinxcontrib.programoutput import ProgramOutputDirective, run_programs

# `dechirp` and `python` of the environment that builds the guide, activated or not.
_PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
_VARIABLES = f"COLUMNS=76 NO_COLOR=1 MPLBACKEND=agg PATH={shlex.quote(_PATH)}"
_SHELL = f"env {_VARIABLES} bash -euo pipefail -c"


class Command(ProgramOutputDirective):
    """A block of shell commands."""

    has_content = True
    required_arguments = 0
    option_spec = {**ProgramOutputDirective.option_spec, "ran": directives.unchanged}  # noqa: RUF012
    """`ran`: command that is run instead, e.g. with fewer trials."""

    def run(self) -> list[nodes.Node]:
        """Run the command; return a block with its text and one with its output."""
        typed = "\n".join(self.content)
        env = self.state.document.settings.env
        self.arguments = [f"{_SHELL} {shlex.quote(self.options.get('ran', typed))} < /dev/null"]
        self.options |= {"shell": None, "class": "printed"}
        output = nodes.Element("", *super().run())
        output[0]["working_directory"] = folder_of(env.app, env.docname)
        env.programoutput_cache.clear()  # later in a page, an equal command may print another text
        run_programs(env.app, output)
        return [
            nodes.literal_block(typed, typed, language="bash", classes=["typed"]),
            *(block for block in output.children if block.astext()),
        ]


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.setup_extension("scratch")
    app.setup_extension("sphinxcontrib.programoutput")
    app.add_directive("command", Command)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
