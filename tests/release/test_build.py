"""Built archives: content, reproducibility, and installation in an empty environment."""

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
from release.pinned_requirements import ROOT, read_pins

MAX_BYTES = 1_000_000


@pytest.fixture(scope="module")
def tracked_files(tmp_path_factory) -> dict[str, bytes]:
    """Read all files that git tracks or would track, without caches."""
    try:
        listing = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a checkout: clone the repository")
    names = listing.stdout.decode().split("\0")
    return {name: (ROOT / name).read_bytes() for name in names if (ROOT / name).is_file()}


def build_archives(tracked_files: Path, out: Path, umask: int) -> dict[str, bytes]:
    """Build the archives of a source tree; return their bytes by suffix."""
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", out],
        cwd=tracked_files,
        check=True,
        capture_output=True,
        umask=umask,
        env={**os.environ, "PYTHONHASHSEED": str(umask)},
    )
    return {file.suffix: file.read_bytes() for file in out.iterdir()}


@pytest.fixture(scope="module")
def archives(tracked_files, tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("built")
    run_leftovers = {"src/dechirp/__pycache__/kernel.nbc": b"", "dechirp-run/report.html": b""}
    for name, content in {**tracked_files, **run_leftovers}.items():
        file = folder / "tree" / name  # permissions of new files: not executable
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return build_archives(folder / "tree", folder / "out", 0o022)


@nightly
def test_rebuild_from_source_archive_is_byte_identical(archives, tmp_path):
    with tarfile.open(fileobj=io.BytesIO(archives[".gz"])) as sdist:
        sdist.extractall(tmp_path, filter="data")
    (unpacked,) = tmp_path.iterdir()
    for file in unpacked.rglob("*"):
        os.utime(file, (2e9, 2e9))
        file.chmod(file.stat().st_mode & 0o700)
    (unpacked / "PKG-INFO").unlink()  # present only in source archives

    assert build_archives(unpacked, tmp_path / "out", 0o077) == archives


@nightly
def test_wheel_contains_only_package(archives, tracked_files):
    with zipfile.ZipFile(io.BytesIO(archives[".whl"])) as wheel:
        content = {name: wheel.read(name) for name in wheel.namelist()}
    package = {f"src/{name}": content[name] for name in content if ".dist-info/" not in name}
    assert package == {
        name: tracked_files[name] for name in tracked_files if name.startswith("src/dechirp/")
    }
    assert {"src/dechirp/py.typed", "src/dechirp/report/page.css"} <= package.keys()
    metadata = {name.partition("/")[2]: content[name] for name in content if ".dist-info/" in name}
    assert metadata.keys() == {
        "METADATA",
        "WHEEL",
        "RECORD",
        "entry_points.txt",
        "licenses/LICENSE",
    }
    assert metadata["licenses/LICENSE"] == tracked_files["LICENSE"]


@nightly
def test_source_archive_omits_pictures_and_recordings(archives, tracked_files):
    with tarfile.open(fileobj=io.BytesIO(archives[".gz"])) as sdist:
        sizes = {member.name.partition("/")[2]: member.size for member in sdist.getmembers()}
    assert sizes.keys() - tracked_files.keys() == {"PKG-INFO"}
    omitted_files = tracked_files.keys() - sizes.keys()
    assert omitted_files == {
        name for name in omitted_files if re.match(r"docs/.*\.(png|html)$", name)
    }
    assert {name: size for name, size in sizes.items() if size > MAX_BYTES} == {}
    # Recordings of others have no licence: tests generate theirs or read external folders.
    suffixes = {".bin", ".dat", ".h5", ".mat", ".mcap", ".npy", ".npz", ".pcap", ".raw", ".wav"}
    recordings = [name for name in sizes if Path(name).suffix in suffixes]
    assert [name for name in recordings if not name.startswith("tests/bad_input/corpus/")] == []
    assert sum(sizes[name] for name in recordings) < MAX_BYTES


@pytest.fixture(scope="module")
def release_folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("released")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    subprocess.run(
        ["bash", ROOT / ".ci" / "release", out], check=True, env={**os.environ, "PATH": path}
    )
    return out


@nightly
def test_bill_of_materials_lists_all_installed_packages(release_folder):
    (file,) = release_folder.glob("*.cdx.json")
    bill = json.loads(file.read_bytes())
    component = bill["metadata"]["component"]
    assert (bill["bomFormat"], component["name"]) == ("CycloneDX", "dechirp")
    assert component["version"] == dechirp.__version__
    listed_packages = {
        (canonicalize_name(entry["name"]), entry["version"]) for entry in bill["components"]
    }
    applicable_pins = [
        pin for pin, _ in read_pins("all.txt") if pin.marker is None or pin.marker.evaluate()
    ]
    assert listed_packages == {
        (pin.name, next(iter(pin.specifier)).version) for pin in applicable_pins
    }
    dependencies = {entry["ref"]: entry.get("dependsOn", []) for entry in bill["dependencies"]}
    reached_refs, pending = set(), [component["bom-ref"]]
    while pending:
        if (ref := pending.pop()) not in reached_refs:
            reached_refs.add(ref)
            pending += dependencies[ref]
    assert reached_refs == dependencies.keys()


@nightly
def test_wheel_runs_in_empty_environment(release_folder, tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    programs = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    working_folder = tmp_path / "elsewhere"
    working_folder.mkdir()
    environment = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    environment["NUMBA_CACHE_DIR"] = str(tmp_path / "numba")

    def call(*words: object) -> str:
        process = subprocess.run(
            [programs / str(words[0]), *map(str, words[1:])],
            check=False,
            cwd=working_folder,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert process.returncode == 0, (words, process.stdout, process.stderr)
        return process.stdout

    call("python", "-m", "pip", "install", "--quiet", *release_folder.glob("*.whl"))
    location = call("python", "-c", "import dechirp; print(dechirp.__file__)")
    assert Path(location.strip()).is_relative_to(tmp_path / "venv")
    (car,) = json.loads(call("dechirp", "run", "--json", "--quiet", "--out", "first"))["detections"]
    assert car["range_m"] == pytest.approx(50, abs=0.05)
    assert (working_folder / "first" / "report.html").stat().st_size > 100_000
    call("dechirp", "doctor")
    for command in ("design", "inspect", "study", "tune", "studio", "twin", "verify", "convert"):
        assert command in call("dechirp", command, "--help")
