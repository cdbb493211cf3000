"""The part of Pyodide that the site carries: pinned by its hash, and only what the page needs."""

import hashlib
import importlib.util
import json
import tarfile
from io import BytesIO
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
NEEDED = ("numpy", "scipy", "pydantic", "jinja2", "threadpoolctl")


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("fetch_pyodide", DOCS / "fetch_pyodide.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(name: str, *depends: str) -> dict[str, object]:
    return {"file_name": f"{name}.whl", "depends": list(depends)}


@pytest.fixture
def archive(tmp_path):
    packages = {name: package(name) for name in (*NEEDED, "openblas", "pandas")}
    packages["scipy"] = package("scipy", "numpy", "openblas")
    packages["openblas"] = package("openblas", "scipy")  # a circle ends, too
    files = {"pyodide-lock.json": json.dumps({"packages": packages}).encode()}
    for name in ("pyodide.js", "pyodide.asm.wasm", "python_stdlib.zip", "console.html"):
        files[name] = name.encode()
    files |= {f"{name}.whl": name.encode() for name in packages}
    path = tmp_path / "pyodide.tar.bz2"
    with tarfile.open(path, "w:bz2") as whole:
        for name, content in files.items():
            entry = tarfile.TarInfo(f"pyodide/{name}")
            entry.size = len(content)
            whole.addfile(entry, BytesIO(content))
    return path


def test_only_what_the_page_needs_is_unpacked(script, archive, tmp_path):
    out = tmp_path / "out"
    sha256 = hashlib.sha256(archive.read_bytes()).hexdigest()
    names = script.fetch(out, archive.as_uri(), sha256)
    assert sorted(names) == sorted(path.name for path in out.iterdir())
    wheels = {path.stem for path in out.glob("*.whl")}
    assert wheels == {*NEEDED, "openblas"}
    assert (out / "numpy.whl").read_bytes() == b"numpy"
    assert (out / "pyodide.asm.wasm").exists() and not (out / "console.html").exists()


def test_another_archive_is_refused_and_leaves_nothing(script, archive, tmp_path):
    with pytest.raises(SystemExit, match="sha256"):
        script.fetch(tmp_path / "out", archive.as_uri(), "0" * 64)
    assert not (tmp_path / "out").exists()


def test_the_pinned_hash_is_one(script):
    assert len(script.SHA256) == 64 and script.VERSION in script.ADDRESS
