"""What users read, word by word; rewritten by  pytest --update-golden."""

import re

import pytest
import typer.main

from rotorfit.cli.main import app

COMMANDS = typer.main.get_command(app).commands


def described(name: str) -> str:
    """Return a command with its options and their help, free of typer's layout."""
    command = COMMANDS[name]
    lines = [name, f"  {' '.join((command.help or '').split())}"]
    for parameter in command.params:
        names = ", ".join(parameter.opts)
        lines.append(f"{names}: {parameter.help}")
    return "\n".join(lines) + "\n"


def squeezed(text: str) -> str:
    return re.sub(r"\s", "", text)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help(run, golden, name):
    text = described(name)
    assert text == golden(f"help/{name}.txt", text)
    ended = run(name, "--help")
    assert (ended.code, ended.err) == (0, "")
    shown = squeezed(ended.out)
    for parameter in COMMANDS[name].params:
        assert parameter.help, f"{name}: {parameter.name} has no help"
        assert squeezed(parameter.help) in shown
        assert all(option in shown for option in parameter.opts if option.startswith("-"))


def test_help_of_the_program(run, golden):
    text = "\n".join(sorted(COMMANDS)) + "\n"
    assert text == golden("help/rotorfit.txt", text)
    for arguments in ((), ("--help",)):
        ended = run(*arguments)
        text = squeezed(ended.out + ended.err)
        for name, command in COMMANDS.items():
            first = (command.help or "").split(".")[0]
            assert name in text
            assert squeezed(first)[:30] in text


def outline(text: str) -> str:
    """Return the headings, and the names and units of the numbers, in their order.

    Digits, verdicts and advice follow the estimate; tests/report holds them word by word.
    """
    lines = [re.sub(r"\d+\.\d+", "x", text.splitlines()[0])]
    for line in text.split("What the verdicts mean")[0].splitlines()[1:]:
        found = re.match(r"  (\w+) +(?:-|\S.*?\d\)?(?:e[-+]\d+)?)(?:  (.*?))?(?:  .*)?$", line)
        lines.append(f"  {found[1]} [{found[2] or ''}]" if found else line)
    return "\n".join(lines) + "\n"


def test_result_as_text(run, here, golden):
    ended = run("identify", "experiment.toml", "--full")
    assert (ended.code, ended.err) == (0, "")
    text = outline(ended.out)
    assert text == golden("result.txt", text)


def test_a_result_in_about_ten_lines(run, here, golden, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    ended = run("identify", "experiment.toml")
    assert (ended.code, ended.err) == (0, "")
    assert len(ended.out.splitlines()) <= 14
    text = re.sub(r"\d+(?:\.\d+)?", "x", ended.out)
    assert text == golden("result-in-short.txt", text)


def test_inspection_as_text(run, here, golden, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    ended = run("inspect", "flight.csv")
    text = re.sub(r"\d+\.\d+", "x", ended.out)
    assert text == golden("inspect.txt", text)


@pytest.mark.parametrize("name", sorted(COMMANDS.keys() - {"inspect"}))
def test_options_are_in_words_not_in_types_of_python(run, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown = run(name, "--help").out
    # What only an argument is, typer itself adds beside its name.
    options = shown.partition("Options:")[2]
    assert not re.search(r"<(str|float|int|list|path)", options), shown
    assert max(map(len, shown.splitlines())) <= 80


def test_every_command_is_described_by_a_whole_clause(run):
    for name, command in COMMANDS.items():
        first = (command.help or "").split("\n\n")[0].rstrip()
        assert first.endswith(".") and ". " not in first, name


def test_help_shows_each_argument_once_without_types(run, assert_text, assert_wording):
    lines = run("fleet", "--help").out.splitlines()
    assert_text(lines[0])
    assert_wording(lines)
    assert_wording(run("airframe", "--help").out)
    for name in COMMANDS:
        shown = run(name, "--help").out
        assert not re.search(r"[<>{}](?!=)", shown), name
        assert all(len(line) <= 80 for line in shown.splitlines())


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (("identify", "x", "--speed", "measurd"), "Did you mean 'measured'?"),
        (("simulate", "singel", "-o", "x"), "Did you mean 'single'?"),
        (("export", "r", "--to", "gazeboo", "-o", "x"), "did you mean gazebo?"),
        (("export", "r", "--to", "sdf", "-o", "x"), "did you mean gazebo?"),
        (("identify", "x", "--mas", "1"), "--mass"),
        (("identify", "x", "a.toml"), "did you mean --airframe a.toml?"),
        (("fly", "x", "--report", "a.pdf"), "a report is a web page: name it a.html"),
        (("identify", "x", "y.bfl"), "one log at a time"),
        (("identify", "x", "--start", "30s"), "expected a number alone, without a unit"),
        (("identify", "x", "--weight", "1"), "Possible options: --mass)"),
        (("identfy", "x"), "'identify'"),
    ],
)
def test_a_misspelt_word_is_given_the_nearest(run, words, near):
    ended = run(*words)
    assert ended.code == 2
    assert near in " ".join(ended.err.split())
