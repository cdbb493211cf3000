"""The site of every release beside that of the present state:  python docs/versions.py OUT

Every tag vX.Y.Z is built into OUT/X.Y.Z, what is checked out into OUT/dev. Each page lists all
versions (from `_static/versions.js` beside it, so that no server is needed), and OUT/index.html
leads to the newest release. A version that is there already is not built again.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
TAG = re.compile(r"v(\d+)\.(\d+)\.(\d+)")
DEV = "dev"
Build = Callable[[Path, Path], None]
"""Builds the site of a tree into a folder."""


def releases(tags: Iterable[str]) -> list[str]:
    """Return the versions of the tags that are releases, the newest first."""
    found = [match for tag in tags if (match := TAG.fullmatch(tag))]
    found.sort(key=lambda match: [int(part) for part in match.groups()], reverse=True)
    return [match[0].removeprefix("v") for match in found]


def build_site(tree: Path, out: Path) -> None:
    """Build the site of one state of the sources, by its own package."""
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html"]
    with tempfile.TemporaryDirectory() as trees:
        subprocess.run(
            [*command, "-d", trees, tree / "docs", out],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree / "src")},
            check=True,
        )


def build_release(version: str, out: Path, root: Path, build: Build) -> None:
    """Build the site of a tag from a checkout of its own."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        add = ["git", "-C", root, "worktree", "add", "--quiet", "--detach", tree, f"v{version}"]
        subprocess.run(add, check=True)
        try:
            build(tree, out)
        finally:
            subprocess.run(["git", "-C", root, "worktree", "remove", "--force", tree], check=True)


def list_versions(out: Path, versions: list[str]) -> None:
    """Write the list of versions into each of them, and the page that leads to the first."""
    line = f"const ROTORFIT_VERSIONS = {json.dumps(versions)};\n"
    for version in versions:
        static = out / version / "_static"
        static.mkdir(parents=True, exist_ok=True)
        (static / "versions.js").write_text(line, encoding="utf-8")
    first = f"{versions[0]}/index.html"
    (out / "index.html").write_text(
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>rotorfit</title>'
        f'<meta http-equiv="refresh" content="0; url={first}">'
        f'<p><a href="{first}">rotorfit {versions[0]}</a></p></html>\n',
        encoding="utf-8",
    )


def build_all(out: Path, root: Path = ROOT, build: Build = build_site) -> list[str]:
    """Build what is missing, and return the versions, the newest release first, then dev."""
    tags = subprocess.run(
        ["git", "-C", root, "tag", "--list"], capture_output=True, text=True, check=True
    ).stdout
    versions = [*releases(tags.split()), DEV]
    for version in versions[:-1]:
        if not (out / version / "index.html").exists():
            build_release(version, out / version, root, build)
    build(root, out / DEV)
    list_versions(out, versions)
    return versions


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.stdout.write(" ".join(build_all(Path(sys.argv[1]).resolve())) + "\n")
