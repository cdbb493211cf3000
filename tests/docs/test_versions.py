"""The site of every release beside the others: which are built, and where their pages lead."""

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import rotorfit

SCRIPT = Path(__file__).parents[2] / "docs" / "versions.py"


@pytest.fixture
def versions():
    spec = importlib.util.spec_from_file_location("site_versions", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_version_changelog_and_citation_are_of_one_release():
    root = SCRIPT.parents[1]
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    heads = re.findall(r"^## (\S+) \((\d{4}-\d{2}-\d{2})\)$", changes, flags=re.MULTILINE)
    cited = re.search(r"^version: (\S+)\ndate-released: \"(\S+)\"$", citation, flags=re.MULTILINE)
    assert cited is not None
    assert heads[0] == cited.groups()
    assert heads[0][0] == rotorfit.__version__


def git(folder: Path, *arguments: str) -> None:
    who = ("-c", "user.name=test", "-c", "user.email=test@example.org")
    subprocess.run(["git", *who, *arguments], cwd=folder, check=True, capture_output=True)


def test_releases_are_sorted_as_numbers_and_other_tags_left_out(versions):
    tags = ["v0.9.0", "v0.10.0", "nightly", "v0.2.11", "v1.0.0rc1"]
    assert versions.releases(tags) == ["0.10.0", "0.9.0", "0.2.11"]


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_each_tag_is_built_from_its_own_state_and_all_list_all(versions, tmp_path):
    root, out = tmp_path / "root", tmp_path / "site"
    root.mkdir()
    git(root, "init", "--quiet")
    for word in ("0.1.0", "0.2.0", "now"):
        (root / "page").write_text(word)
        git(root, "add", "page")
        git(root, "commit", "--quiet", "-m", word)
        if word != "now":
            git(root, "tag", f"v{word}")

    def copied(tree: Path, target: Path) -> None:
        target.mkdir(parents=True)
        (target / "index.html").write_text((tree / "page").read_text())

    assert versions.build_all(out, root, copied) == ["0.2.0", "0.1.0", "dev"]
    pages = {name: (out / name / "index.html").read_text() for name in ("0.1.0", "0.2.0", "dev")}
    assert pages == {"0.1.0": "0.1.0", "0.2.0": "0.2.0", "dev": "now"}
    for name in pages:
        listed = (out / name / "_static" / "versions.js").read_text()
        assert listed == 'const ROTORFIT_VERSIONS = ["0.2.0", "0.1.0", "dev"];\n'
    assert 'url=0.2.0/index.html"' in (out / "index.html").read_text()

    shutil.rmtree(out / "dev")
    (out / "0.1.0" / "index.html").write_text("kept")
    versions.build_all(out, root, copied)
    assert (out / "0.1.0" / "index.html").read_text() == "kept"
    left = subprocess.run(["git", "worktree", "list"], cwd=root, capture_output=True, text=True)
    assert left.stdout.count("\n") == 1
