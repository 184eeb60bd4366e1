"""`dechirp completion`: the script by which a shell completes commands and options."""

from typing import Literal, TypeAlias

Shell: TypeAlias = Literal["bash", "zsh", "fish"]


def completion(shell: Shell, /) -> int:
    """Print the script by which a shell completes commands and options.

    For bash, add `source <(dechirp completion bash)` to ~/.bashrc, or save what it prints as
    ~/.local/share/bash-completion/completions/dechirp, which takes no time when a shell starts.
    For zsh, save it as _cyclopts_dechirp in a folder of $fpath; for fish, as
    ~/.config/fish/completions/dechirp.fish.

    Parameters
    ----------
    shell
        The shell that is to load it.
    """
    from dechirp.cli.main import app

    print(app().generate_completion(shell=shell), end="")
    return 0
