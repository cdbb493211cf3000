"""The page on which logs are dropped, for a web server that only hands out files.

It runs rotorfit in the browser. Python, NumPy and the others come from a folder of Pyodide's files,
which is copied beside it: nothing is loaded from another address.
"""

import importlib.metadata
import json
import shutil
import zipfile
from pathlib import Path

import rotorfit

PACKAGES = ["numpy", "scipy", "pydantic", "jinja2", "threadpoolctl"]
"""Of Pyodide's own distribution."""
BESIDE = ["jaxtyping", "wadler-lindig"]
"""What that lacks: Python alone, taken as it is installed here."""
ARCHIVE = "rotorfit.zip"


def write_page(folder: Path, pyodide: Path | None) -> None:
    """Write the page and what it runs into a folder.

    Parameters
    ----------
    folder
        In the site; what is there is replaced.
    pyodide
        Folder of a Pyodide distribution; None: the page says that it has none.
    """
    package = Path(rotorfit.__file__).parent
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(package / "app" / "static", folder)
    where = None
    if pyodide is not None:
        shutil.copytree(pyodide, folder / "pyodide")
        where = "pyodide/"
    write_archive(folder / ARCHIVE, package)
    settings = {"engine": "worker", "pyodide": where, "packages": PACKAGES, "archives": [ARCHIVE]}
    (folder / "engine.json").write_text(json.dumps(settings, indent=1), encoding="utf-8")


def write_archive(path: Path, package: Path) -> None:
    """Write rotorfit, and what Pyodide lacks of its dependencies, into one archive."""
    left_out = ("__pycache__", "static")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(package.rglob("*")):
            if file.is_file() and not set(left_out) & set(file.parts[len(package.parts) :]):
                archive.write(file, Path("rotorfit") / file.relative_to(package))
        for name in BESIDE:
            for file in importlib.metadata.files(name) or ():
                if "__pycache__" not in file.parts and ".." not in file.parts:
                    archive.write(file.locate(), str(file))
