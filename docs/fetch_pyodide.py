"""Fetch the part of Pyodide that the page in the browser needs:  python docs/fetch_pyodide.py OUT

The release is pinned by its hash: another archive, or a damaged one, is refused and nothing is
written. Of its packages only those are unpacked that rotorfit needs.
"""

import hashlib
import json
import re
import sys
import tarfile
import tempfile
import urllib.request
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from page_site import PACKAGES

VERSION = "0.29.3"
ADDRESS = (
    f"https://github.com/pyodide/pyodide/releases/download/{VERSION}/pyodide-{VERSION}.tar.bz2"
)
SHA256 = "458e8ddbcbb6e21037d3237cd5c5146c451765bc738dfa2249ff34c5140331e4"
CORE = re.compile(r"pyodide(-lock)?\.(js|json|mjs|asm\.\w+)|python_stdlib\.zip")
LOCK = "pyodide-lock.json"


def fetch(out: Path, address: str = ADDRESS, sha256: str = SHA256) -> list[str]:
    """Download an archive, compare its hash, unpack what the page needs; return the file names."""
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "pyodide.tar.bz2"
        urllib.request.urlretrieve(address, archive)
        with archive.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if found != sha256:
            sys.exit(f"{address}: its sha256 is {found}, expected {sha256}; nothing was unpacked")
        return unpack(archive, out)


def unpack(archive: Path, out: Path) -> list[str]:
    """Unpack the core and the packages that rotorfit needs, without the archive's folder."""
    with tarfile.open(archive) as whole:
        members = {PurePosixPath(one.name).name: one for one in whole if one.isfile()}
        lock = whole.extractfile(members[LOCK])
        assert lock is not None
        packages = needed(json.load(lock)["packages"], PACKAGES)
        names = [name for name in members if CORE.fullmatch(name) or name in packages]
        if missing := packages - set(names):
            sys.exit(f"the archive lacks {', '.join(sorted(missing))}; nothing was unpacked")
        out.mkdir(parents=True, exist_ok=True)
        for name in names:
            content = whole.extractfile(members[name])
            assert content is not None
            (out / name).write_bytes(content.read())
    return names


def needed(packages: Mapping[str, Any], wanted: Iterable[str]) -> set[str]:
    """Return the files of packages and of all that these depend on."""
    waiting, seen = list(wanted), set[str]()
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting += packages[name]["depends"]
    return {packages[name]["file_name"] for name in seen}


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.stdout.write(f"{len(fetch(Path(sys.argv[1])))} files of Pyodide {VERSION}\n")
