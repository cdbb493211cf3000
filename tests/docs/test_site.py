"""The site is built without a warning, and its links lead somewhere."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

pytest.importorskip("sphinx", reason='the site needs  pip install "rotorfit[docs]"')

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LINK = re.compile(r'(?:href|src)="([^"#]*)(?:#([^"]*))?"')


def build(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sphinx", "-q", "-n", "-W", "--keep-going", "-b", "html"]
    return subprocess.run(
        [*command, "-d", out / "trees", source, out / "html"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("site")
    ended = build(DOCS, out)
    assert ended.returncode == 0, ended.stderr
    return out / "html"


def test_every_page_is_in_the_site(site):
    pages = {path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md")}
    built = {path.relative_to(site).with_suffix("") for path in site.rglob("*.html")}
    assert pages <= built


def test_links_lead_somewhere(site):
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    wrong: list[str] = []
    for page, text in pages.items():
        for file, anchor in LINK.findall(text):
            if ":" in file:
                continue  # another host: not asked here
            target = (page.parent / unquote(file.split("?")[0])).resolve() if file else page
            if not target.exists():
                wrong.append(f"{page.name}: {file}")
            elif anchor and target.suffix == ".html" and f'id="{anchor}"' not in pages[target]:
                wrong.append(f"{page.name}: {file}#{anchor}")
    assert not wrong


def test_pages_need_no_network(site):
    first = (site / "index.html").read_text(encoding="utf-8")
    scripts = re.findall(r'<(?:script|link)[^>]*(?:src|href)="(https?:[^"]*)"', first)
    assert scripts == []


def test_formulas_are_drawn_by_the_browser(site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math") > 40
    assert "$$" not in theory


def test_every_public_name_is_in_the_reference(site):
    import rotorfit

    reference = (site / "reference.html").read_text(encoding="utf-8")
    # A module's anchor is module-rotorfit.name.
    missing = [name for name in dir(rotorfit) if f'rotorfit.{name}"' not in reference]
    assert missing == ["__version__"]


def test_every_option_of_every_command_is_on_the_site(site):
    import typer.main

    from rotorfit.cli.main import app

    page = (site / "commands.html").read_text(encoding="utf-8")
    for name, command in typer.main.get_command(app).commands.items():
        shown = page.partition(f"Usage: rotorfit {name} ")[2].partition("</pre>")[0]
        for parameter in command.params:
            assert all(option in shown for option in parameter.opts if option.startswith("-"))


@pytest.mark.parametrize(
    ("wrong", "warning"),
    [
        ("[gone](nowhere.md)", "nowhere"),
        ("[gone](paper.md#nowhere)", "nowhere"),
        ("{py:func}`rotorfit.indentify`", "rotorfit.indentify"),
    ],
)
@pytest.mark.slow
def test_a_wrong_link_is_noticed(tmp_path, wrong, warning):
    source = tmp_path / "docs"
    source.mkdir()
    for name in ("conf.py", "paper.md"):
        shutil.copy(DOCS / name, source)
    shutil.copytree(DOCS / "_static", source / "_static")
    (source / "index.md").write_text(f"# Index\n\n{wrong}\n\n```{{toctree}}\npaper\n```\n")
    ended = build(source, tmp_path)
    assert ended.returncode != 0
    assert warning in ended.stderr
