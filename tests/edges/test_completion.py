"""The shell completes commands and options."""

import shutil
import subprocess

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


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    return tmp_path_factory.mktemp("completion") / "dechirp"


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("dechirp ver", "verify"),
        ("dechirp sch", "schema"),
        ("dechirp run --js", "--json"),
        ("dechirp schema requ", "requirements"),
        ("dechirp completion z", "zsh"),
        ("dechirp design --rule rou", "round-trips"),
    ],
)
def test_bash_completes(words, offered, script, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["completion", "bash"])
    assert ended.value.code == 0
    script.write_text(capsys.readouterr().out, encoding="utf-8")

    done = subprocess.run(
        ["bash", "--norc", "-c", ASK.format(script=script, words=words)],
        text=True,
        capture_output=True,
        check=True,
    )
    assert done.stderr == ""
    assert done.stdout.split() == [offered]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script_too(shell, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["completion", shell])

    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "dechirp" in printed and "--false-alarm-probability" in printed.replace("-l ", "--")


def test_a_shell_that_is_not_known_is_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["completion", "tcsh"])

    assert ended.value.code == 2
    assert "bash" in capsys.readouterr().err
