"""What is built is what is in the tree, the same to the byte, and works where nothing else is."""

import io
import json
import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

import dechirp
from nightly import nightly
from release.pinned import ROOT, pins

LARGEST_BYTES = 1_000_000


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> dict[str, bytes]:
    """What git keeps or would keep; nothing of caches."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a checkout")
    names = listed.stdout.decode().split("\0")
    return {name: (ROOT / name).read_bytes() for name in names if (ROOT / name).is_file()}


def built(tree: Path, out: Path, umask: int) -> dict[str, bytes]:
    """Archives that are made of a tree."""
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", out],
        cwd=tree,
        check=True,
        capture_output=True,
        umask=umask,
        env={**os.environ, "PYTHONHASHSEED": str(umask)},
    )
    return {file.suffix: file.read_bytes() for file in out.iterdir()}


@pytest.fixture(scope="module")
def archives(tree, tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("built")
    left_by_runs = {"src/dechirp/__pycache__/kernel.nbc": b"", "dechirp-run/report.html": b""}
    for name, content in {**tree, **left_by_runs}.items():
        file = folder / "tree" / name  # with the rights of new files: no one may run them
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return built(folder / "tree", folder / "out", 0o022)


def test_what_is_built_elsewhere_and_later_is_the_same(archives, tmp_path):
    with tarfile.open(fileobj=io.BytesIO(archives[".gz"])) as sdist:
        sdist.extractall(tmp_path, filter="data")
    (elsewhere,) = tmp_path.iterdir()
    for file in elsewhere.rglob("*"):
        os.utime(file, (2e9, 2e9))
        file.chmod(file.stat().st_mode & 0o700)
    (elsewhere / "PKG-INFO").unlink()  # what makes a source archive of a tree

    assert built(elsewhere, tmp_path / "out", 0o077) == archives


def test_the_wheel_is_the_package_and_nothing_else(archives, tree):
    with zipfile.ZipFile(io.BytesIO(archives[".whl"])) as wheel:
        content = {name: wheel.read(name) for name in wheel.namelist()}
    package = {f"src/{name}": content[name] for name in content if ".dist-info/" not in name}
    assert package == {name: tree[name] for name in tree if name.startswith("src/dechirp/")}
    assert {"src/dechirp/py.typed", "src/dechirp/report/page.typ"} <= package.keys()
    about = {name.partition("/")[2]: content[name] for name in content if ".dist-info/" in name}
    assert about.keys() == {"METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE"}
    assert about["licenses/LICENSE"] == tree["LICENSE"]


def test_the_source_archive_has_the_tree_without_pictures_and_recordings(archives, tree):
    with tarfile.open(fileobj=io.BytesIO(archives[".gz"])) as sdist:
        sizes = {one.name.partition("/")[2]: one.size for one in sdist.getmembers()}
    assert sizes.keys() - tree.keys() == {"PKG-INFO"}
    left_out = tree.keys() - sizes.keys()
    assert left_out == {name for name in left_out if re.match(r"docs/.*\.(png|html)$", name)}
    assert {name: size for name, size in sizes.items() if size > LARGEST_BYTES} == {}
    # Data of others come with no licence: tests make theirs, or look for them outside.
    recordings = {".bin", ".dat", ".h5", ".mat", ".mcap", ".npy", ".npz", ".pcap", ".raw", ".wav"}
    found = [name for name in sizes if Path(name).suffix in recordings]
    assert [name for name in found if not name.startswith("tests/bad_input/corpus/")] == []
    assert sum(sizes[name] for name in found) < LARGEST_BYTES


@pytest.fixture(scope="module")
def released(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("released")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    subprocess.run(
        ["bash", ROOT / ".ci" / "release", out], check=True, env={**os.environ, "PATH": path}
    )
    return out


@nightly
def test_the_bill_of_materials_names_everything_that_is_installed(released):
    (file,) = released.glob("*.cdx.json")
    bill = json.loads(file.read_bytes())
    about = bill["metadata"]["component"]
    assert (bill["bomFormat"], about["name"]) == ("CycloneDX", "dechirp")
    assert about["version"] == dechirp.__version__
    listed = {(canonicalize_name(one["name"]), one["version"]) for one in bill["components"]}
    here = [pin for pin, _ in pins("all.txt") if pin.marker is None or pin.marker.evaluate()]
    assert listed == {(pin.name, next(iter(pin.specifier)).version) for pin in here}
    needs = {one["ref"]: one.get("dependsOn", []) for one in bill["dependencies"]}
    reached, left = set(), [about["bom-ref"]]
    while left:
        if (ref := left.pop()) not in reached:
            reached.add(ref)
            left += needs[ref]
    assert reached == needs.keys()


@nightly
def test_the_wheel_alone_runs_in_an_empty_environment(released, tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    programs = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    alone = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    alone["NUMBA_CACHE_DIR"] = str(tmp_path / "numba")

    def call(*words: object) -> str:
        done = subprocess.run(
            [programs / str(words[0]), *map(str, words[1:])],
            check=False,
            cwd=elsewhere,
            env=alone,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        return done.stdout

    call("python", "-m", "pip", "install", "--quiet", *released.glob("*.whl"))
    where = call("python", "-c", "import dechirp; print(dechirp.__file__)")
    assert Path(where.strip()).is_relative_to(tmp_path / "venv")
    (car,) = json.loads(call("dechirp", "run", "--json", "--quiet", "--out", "first"))["detections"]
    assert car["range_m"] == pytest.approx(50, abs=0.05)
    assert (elsewhere / "first" / "report.html").stat().st_size > 100_000
    call("dechirp", "doctor")
    for command in ("design", "inspect", "study", "tune", "studio", "twin", "verify", "convert"):
        assert command in call("dechirp", command, "--help")
