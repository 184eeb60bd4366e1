"""`dechirp completion`: completion script for a shell."""

from typing import Literal, TypeAlias

Shell: TypeAlias = Literal["bash", "zsh", "fish"]


def completion(shell: Shell, /) -> int:
    """Print the completion script of commands and options for a shell.

    For bash, add `source <(dechirp completion bash)` to ~/.bashrc, or save the output as
    ~/.local/share/bash-completion/completions/dechirp, which does not delay the start of a shell.
    For zsh, save it as _cyclopts_dechirp in a folder of $fpath; for fish, as
    ~/.config/fish/completions/dechirp.fish.

    Parameters
    ----------
    shell
        Shell that loads the script.
    """
    from dechirp.cli.main import build_command_line_app

    print(build_command_line_app().generate_completion(shell=shell), end="")
    return 0
