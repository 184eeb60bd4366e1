"""Shell completion of commands and options in bash, fish and zsh."""

import os
import pty
import select
import shutil
import subprocess
from time import monotonic

import pytest

from dechirp.cli.main import main

# Readline protocol: words before the cursor, completion function, offered replies.
BASH_QUERY = """\
source {script}
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_dechirp
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
COMPLETIONS = [
    ("dechirp ver", "verify"),
    ("dechirp sch", "schema"),
    ("dechirp run --js", "--json"),
    ("dechirp schema requ", "requirements"),
    ("dechirp completion z", "zsh"),
    ("dechirp list multip", "multiplexing"),
    ("dechirp design --rule rou", "round-trips"),
]


@pytest.fixture
def print_script(capsys):
    def print_for_shell(shell):
        with pytest.raises(SystemExit) as exit_info:
            main(["completion", shell])
        assert exit_info.value.code == 0
        return capsys.readouterr().out

    return print_for_shell


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash not found: install it")
def test_bash_completes_commands_and_options(print_script, tmp_path):
    script = tmp_path / "dechirp"
    script.write_text(print_script("bash"), encoding="utf-8")
    for typed_text, completion in COMPLETIONS:
        assert run_query(
            ["bash", "--norc", "-c", BASH_QUERY.format(script=script, words=typed_text)]
        ) == [completion]


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish not found: install it")
def test_fish_completes_commands_and_options(print_script, tmp_path):
    script = tmp_path / "dechirp.fish"
    script.write_text(print_script("fish"), encoding="utf-8")
    for typed_text, completion in COMPLETIONS:
        first, *_ = run_query(["fish", "-N", "-c", f"source {script}; complete -C '{typed_text}'"])
        assert first == completion


def run_query(command):
    process = subprocess.run(command, text=True, capture_output=True, check=True)
    assert process.stderr == ""
    return process.stdout.split()


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh not found: install it")
def test_zsh_completes_commands_and_options(print_script, tmp_path):
    # zsh runs the function only if the file has its name.
    (tmp_path / "_cyclopts_dechirp").write_text(print_script("zsh"), encoding="utf-8")
    terminal, shell_end = pty.openpty()
    shell = subprocess.Popen(
        ["zsh", "-f", "-i"],
        stdin=shell_end,
        stdout=shell_end,
        stderr=shell_end,
        start_new_session=True,
    )
    os.close(shell_end)
    try:
        send_text(terminal, f"PS1='rea''dy '; fpath=({tmp_path} $fpath)\n")
        send_text(terminal, "autoload -Uz compinit; compinit -u -D\n")
        wait_for_text(terminal, "ready ", times=2)
        for typed_text, completion in COMPLETIONS:
            send_text(terminal, f"{typed_text}\t")
            wait_for_text(terminal, completion)
            send_text(terminal, "\x15")
    finally:
        shell.kill()
        shell.wait()
        os.close(terminal)


def send_text(terminal, text):
    os.write(terminal, text.encode())


def wait_for_text(terminal, text, *, times=1):
    output, start = "", monotonic()
    while output.count(text) < times:
        assert monotonic() - start < 60, f"zsh shows no {text!r} but {output!r}"
        if select.select([terminal], [], [], 0.1)[0]:
            output += os.read(terminal, 65536).decode(errors="replace")
