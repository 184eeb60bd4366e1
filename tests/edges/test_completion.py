"""The shell completes commands and options: asked as it asks itself when somebody presses Tab."""

import os
import pty
import select
import shutil
import subprocess
from time import monotonic

import pytest

from dechirp.cli.main import main

# What readline does: the words before the cursor, the function, and what it offers.
ASK = """\
source {script}
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_dechirp
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
OFFERED = [
    ("dechirp ver", "verify"),
    ("dechirp sch", "schema"),
    ("dechirp run --js", "--json"),
    ("dechirp schema requ", "requirements"),
    ("dechirp completion z", "zsh"),
    ("dechirp list multip", "multiplexing"),
    ("dechirp design --rule rou", "round-trips"),
]


@pytest.fixture
def printed(capsys):
    def of(shell):
        with pytest.raises(SystemExit) as ended:
            main(["completion", shell])
        assert ended.value.code == 0
        return capsys.readouterr().out

    return of


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes(printed, tmp_path):
    script = tmp_path / "dechirp"
    script.write_text(printed("bash"), encoding="utf-8")
    for words, offered in OFFERED:
        assert asked(["bash", "--norc", "-c", ASK.format(script=script, words=words)]) == [offered]


@pytest.mark.skipif(shutil.which("fish") is None, reason="there is no fish")
def test_fish_completes(printed, tmp_path):
    script = tmp_path / "dechirp.fish"
    script.write_text(printed("fish"), encoding="utf-8")
    for words, offered in OFFERED:
        first, *_ = asked(["fish", "-N", "-c", f"source {script}; complete -C '{words}'"])
        assert first == offered


def asked(command):
    done = subprocess.run(command, text=True, capture_output=True, check=True)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("zsh") is None, reason="there is no zsh")
def test_zsh_completes(printed, tmp_path):
    # The name of the file is the name of the function in it, without which zsh runs nothing.
    (tmp_path / "_cyclopts_dechirp").write_text(printed("zsh"), encoding="utf-8")
    terminal, inside = pty.openpty()
    shell = subprocess.Popen(
        ["zsh", "-f", "-i"], stdin=inside, stdout=inside, stderr=inside, start_new_session=True
    )
    os.close(inside)
    try:
        send(terminal, f"PS1='rea''dy '; fpath=({tmp_path} $fpath)\n")
        send(terminal, "autoload -Uz compinit; compinit -u -D\n")
        wait_for(terminal, "ready ", times=2)
        for words, offered in OFFERED:
            send(terminal, f"{words}\t")
            wait_for(terminal, offered)
            send(terminal, "\x15")
    finally:
        shell.kill()
        shell.wait()
        os.close(terminal)


def send(terminal, text):
    os.write(terminal, text.encode())


def wait_for(terminal, text, *, times=1):
    seen, start = "", monotonic()
    while seen.count(text) < times:
        assert monotonic() - start < 60, f"zsh shows no {text!r} but {seen!r}"
        if select.select([terminal], [], [], 0.1)[0]:
            seen += os.read(terminal, 65536).decode(errors="replace")
