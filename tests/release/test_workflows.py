"""Workflows: they call the scripts of `.ci`, with few rights and for the declared Pythons."""

import re
from pathlib import Path

import pytest
from check_jsonschema.cli import main as check_jsonschema
from ruamel.yaml import YAML

from release.pinned_requirements import PROJECT, ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))

# Steps that need no script: tools for one, and files of a release that exist on GitHub alone.
SETUP_COMMANDS = {
    'python -m pip install --quiet "uv>=0.9"',
    "python -m pip install --quiet --require-hashes -r requirements/ci.txt",
    'test -f "dist/dechirp-${GITHUB_REF_NAME#v}-py3-none-any.whl"',
    "sha256sum -- * > SHA256SUMS",
    'gh release create "$GITHUB_REF_NAME" dist/* --draft --verify-tag --title "$GITHUB_REF_NAME"',
}

EXTRA_PERMISSIONS = {
    ("release", "publish"): {"id-token": "write"},
    ("release", "draft"): {"contents": "write"},
}


# Files by their schema in check-jsonschema, which contains copies of the published ones.
FILES_BY_SCHEMA = {
    "vendor.github-workflows": ".github/workflows/*.yml",
    "custom.github-workflows-require-timeout": ".github/workflows/*.yml",
    "vendor.github-issue-forms": ".github/ISSUE_TEMPLATE/[!c]*.yml",
    "vendor.github-issue-config": ".github/ISSUE_TEMPLATE/config.yml",
    "vendor.dependabot": ".github/dependabot.yml",
    "vendor.readthedocs": ".readthedocs.yaml",
    "vendor.citation-file-format": "CITATION.cff",
}


def lint(schema: str, *files: Path) -> int:
    with pytest.raises(SystemExit) as end:
        check_jsonschema(["--builtin-schema", schema, *map(str, files)])
    return end.value.code


def read_yaml(path: Path) -> dict:
    return YAML(typ="safe").load(path.read_text(encoding="utf-8"))


def read_script(name: str) -> str:
    return (ROOT / ".ci" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(("schema", "pattern"), FILES_BY_SCHEMA.items())
def test_files_of_services_pass_their_linter(schema, pattern):
    files = sorted(ROOT.glob(pattern))
    assert files
    assert lint(schema, *files) == 0


def test_linter_refuses_a_job_without_a_machine(tmp_path):
    text = (ROOT / ".github" / "workflows" / "guide.yml").read_text(encoding="utf-8")
    (tmp_path / "guide.yml").write_text(text.replace("runs-on", "runs_on"), encoding="utf-8")
    assert lint("vendor.github-workflows", tmp_path / "guide.yml") == 1


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflow_calls_existing_scripts_with_read_permission(path):
    workflow = read_yaml(path)
    assert workflow["permissions"] == {"contents": "read"}
    for name, job in workflow["jobs"].items():
        assert job.get("permissions", {}) == EXTRA_PERMISSIONS.get((path.stem, name), {}), name
        if "uses" in job:
            assert (ROOT / job["uses"]).is_file()
            continue
        assert job["timeout-minutes"] <= 360, name
        for step in job["steps"]:
            command = step.get("run")
            if script := re.fullmatch(r"bash \.ci/(\w+)", command or ""):
                assert read_script(script[1]).startswith("#!/usr/bin/env bash\n"), command
            else:
                assert "uses" in step or command in SETUP_COMMANDS, command
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"] == {"persist-credentials": False}


def test_declared_pythons_are_those_of_scripts_and_jobs():
    declared = {
        match[1]
        for line in PROJECT["classifiers"]
        if (match := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
    }
    (defaults,) = re.findall(r"in \$\{VERSIONS:-oldest ([\d. ]+)\}", read_script("versions"))
    jobs = read_yaml(ROOT / ".github" / "workflows" / "tests.yml")["jobs"]
    tested = {entry["version"] for entry in jobs["versions"]["strategy"]["matrix"]["include"]}

    assert declared == set(defaults.split()) == tested - {"oldest"}
    assert "oldest" in tested
    assert set(jobs["systems"]["strategy"]["matrix"]["python"]) == declared


def test_public_guide_is_built_from_pins_and_fails_on_warnings():
    settings = read_yaml(ROOT / ".readthedocs.yaml")
    requirements, package = settings["python"]["install"]
    assert (ROOT / requirements["requirements"]).is_file()
    assert package == {"method": "pip", "path": "."}
    assert settings["sphinx"] == {"configuration": "docs/conf.py", "fail_on_warning": True}
