"""What the pages tell the reader to type is typed: commands, and the lines of Python.

Every shell block runs, page by page, in a folder that holds a short simulated flight as a reader
would have it; a block that cannot run here (a real log, a device) says why in the line before it:
``<!-- not run: REASON -->``. Its lines are still held against the options that there are, and so
are those of the README and the examples of ``--help``.
"""

import ast
import contextlib
import functools
import io
import os
import re
import shlex
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
import typer.main
from click.core import ParameterSource

import rotorfit
from rotorfit.cli.main import app, main
from rotorfit.digits import with_interval

COMMANDS = typer.main.get_command(app).commands
DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>.+?) -->\n)?```(?P<kind>sh|python)\n(?P<text>.*?)```", re.S
)


class Block(NamedTuple):
    """One block of a page; `why` it is not run, where it is not."""

    kind: str
    text: str
    why: str | None


def blocks_of(page: Path, kind: str) -> list[Block]:
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    blocks = [Block(m["kind"], m["text"], m["why"]) for m in found]
    return [block for block in blocks if block.kind == kind]


class Typed(NamedTuple):
    """A command that was typed, how it ended, and what it printed."""

    line: str
    code: int
    out: str
    err: str


class Ran(NamedTuple):
    """The commands of a page, and the folder in which they ran."""

    folder: Path
    typed: list[Typed]


PAGES = sorted(DOCS.rglob("*.md"))
WITH_TUTORIAL = DOCS / "export.md"  # the tutorial's result is the one that it speaks of
WITH_COMMANDS = [page for page in PAGES if blocks_of(page, "sh") and page != WITH_TUTORIAL]
SLOW = ("payload", "plan")  # two configurations of two flights each; every manoeuvre flown
LAW = """speed = "commanded"
law = { polynomial = [0.0, 1900.0, -450.0], voltage = { nominal = 16.0 } }"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    """A folder with an experiment by motor commands, its result, and the files that pages name."""
    folder = tmp_path_factory.mktemp("flown")
    experiment_file = rotorfit.simulate(folder, "single", "real", seconds=15.0)
    text = experiment_file.read_text(encoding="utf-8").replace('speed = "measured"', LAW)
    experiment_file.write_text(text, encoding="utf-8")
    result = rotorfit.identify(rotorfit.load_experiment(experiment_file))
    result.save(folder / "result.json")
    result.save(folder / "other.json")
    (folder / "airframe.toml").write_text(text[text.index("[airframe]") : text.index("[identif")])
    return folder


@pytest.fixture(scope="module")
def run_page(flown, tmp_path_factory) -> Callable[[Path], Ran]:
    """Run the commands of a page once, in a folder that holds what the pages name."""

    @functools.cache
    def run(page: Path) -> Ran:
        here = tmp_path_factory.mktemp(page.stem)
        shutil.copytree(flown, here, dirs_exist_ok=True)
        lines = commands_of(page)
        if page.stem == "tutorial":
            lines += commands_of(WITH_TUTORIAL)
        if any("-o result.json" in line for line in lines):
            (here / "result.json").unlink()  # this page makes its own
        with contextlib.chdir(here):
            return Ran(here, [typed(line) for line in lines])

    return run


def typed(line: str) -> Typed:
    """Run one command as the shell would, in this process."""
    name, *arguments = [os.path.expandvars(word) for word in shlex.split(line, comments=True)]
    assert name == "rotorfit", f"{line!r} is not run by the tests: mark its block"
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main(arguments)
    code = ended.value.code if isinstance(ended.value.code, int) else 0
    return Typed(line, code, out.getvalue(), err.getvalue())


def lines_of(block: Block) -> list[str]:
    joined = block.text.replace("\\\n", " ")
    return [line for line in joined.splitlines() if line.strip() and not line.startswith("#")]


def commands_of(page: Path) -> list[str]:
    """Return the commands of a page that can run here."""
    return [line for block in blocks_of(page, "sh") if not block.why for line in lines_of(block)]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in SLOW else [])
        for page in WITH_COMMANDS
    ],
)
def test_commands(page, run_page):
    if not commands_of(page):
        pytest.skip("; ".join(block.why or "" for block in blocks_of(page, "sh")))
    for ended in run_page(page).typed:
        assert ended.code == 0, f"{ended.line}\n{ended.err}"
        assert ended.out.strip(), f"{ended.line} printed nothing"


README = DOCS.parent / "README.md"
SHOWN = [
    *(line for page in (*PAGES, README) for b in blocks_of(page, "sh") for line in lines_of(b)),
    *(str(command.epilog).removeprefix("Example: ") for command in COMMANDS.values()),
]


@pytest.mark.parametrize("line", sorted({line for line in SHOWN if line.startswith("rotorfit ")}))
def test_every_command_that_is_shown_is_one(line):
    _, name, *words = shlex.split(line, comments=True)
    given = COMMANDS[name].make_context(name, words)  # refuses an unknown option or choice
    options = {param.name: [*param.opts, *param.secondary_opts] for param in given.command.params}
    flags = {word.split("=")[0] for word in words if word.startswith("-")}
    taken = {
        flag
        for param, names in options.items()
        for flag in flags.intersection(names)
        if given.get_parameter_source(param) is ParameterSource.COMMANDLINE
    }
    assert taken == flags


def test_every_command_has_an_example():
    shown = {name: str(command.epilog) for name, command in COMMANDS.items()}
    assert [n for n, text in shown.items() if not text.startswith(f"Example: rotorfit {n} ")] == []


def test_the_list_of_commands_is_not_cut():
    texts = [command.get_short_help_str(64) for command in COMMANDS.values()]
    assert [text for text in texts if not text.endswith(".") or text.endswith("...")] == []


def test_most_pages_with_commands_run_some():
    run = [p.stem for p in WITH_COMMANDS if any(not b.why for b in blocks_of(p, "sh"))]
    assert {"tutorial", "plan", "payload", "mocap"} <= set(run)
    assert commands_of(WITH_TUTORIAL)


QUOTED = re.compile(
    r"`kd  (?P<number>\S.*\S)  N m s\^2/rad\^2  (?P<verdict>\S+)`.*\n"
    r"(?P<between>.*is between )(?P<low>\S+) and (?P<high>\S+) \("
)
"""How the tutorial quotes the line of kd, and the ends of its interval."""
PRINTED = re.compile(r"^(?P<line>print\(vehicles\)\n# )(?P<said>.*)$", re.MULTILINE)


def assert_quoted(page: Path, pattern: re.Pattern[str], update: bool, **now: str) -> None:
    """Assert that a page quotes what is so now; `update` writes it there."""
    text = page.read_text(encoding="utf-8")
    found = pattern.search(text)
    assert found is not None
    if update:
        for name in sorted(now, key=found.start, reverse=True):  # from the end: places stay
            text = text[: found.start(name)] + now[name] + text[found.end(name) :]
        page.write_text(text, encoding="utf-8")
        return
    assert {name: found[name] for name in now} == now


def test_the_lines_of_python(tmp_path, monkeypatch, capsys, request):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks_of(DOCS / "python.md", "python"):
        if "rotorfit.plot" in block.text and find_spec("matplotlib") is None:
            continue  # an extra
        exec(block.text, names)
    printed = capsys.readouterr().out
    update = request.config.getoption("--update-golden")
    assert_quoted(DOCS / "python.md", PRINTED, update, said=str(names["vehicles"]))
    assert "single-real: 1 flight" in printed
    assert "N s^2/rad^2 identified" in printed
    assert (tmp_path / "quad.urdf").read_text().count("<joint") == 5  # four rotors, the CoM
    assert isinstance(names["unseen"], rotorfit.WrenchComparison)
    statements = ast.parse(blocks_of(DOCS / "python.md", "python")[0].text).body
    assert sum(not isinstance(line, ast.Import | ast.ImportFrom) for line in statements) == 10


def test_the_tutorial_quotes_its_own_result(run_page, request):
    result = run_page(DOCS / "tutorial.md").folder / "result.json"
    kd = rotorfit.IdentificationResult.load(result).parameter("kd")
    assert kd.value is not None and kd.interval is not None
    low, high = (f"{end:.2e}".replace("e-0", "e-") for end in kd.interval)
    number, verdict = with_interval(kd.value, kd.interval), str(kd.verdict)
    update = request.config.getoption("--update-golden")
    page = DOCS / "tutorial.md"
    assert_quoted(page, QUOTED, update, number=number, verdict=verdict, low=low, high=high)
