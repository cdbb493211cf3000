"""Every command that an output names runs as it is printed, without an edit."""

import re
import shlex
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest
import typer.main
from blackbox_file import blackbox_of
from command_line import called

from rotorfit.cli.main import app
from rotorfit.sheet import COMMAND, wrapped

FIRST = ("inspect", "airframe", "identify")
"""What a newcomer may try with a log."""
NAMES = typer.main.get_command(app).commands
MOST = 12
"""Commands of one log; more would be a circle."""
UNRUNNABLE = re.compile(r"no file|no such|exists|internal error|no answer|Traceback", re.I)
LEFT_OUT = re.compile(r"README|LICENSE|\.(toml|md|json|yaml|out)$")
SLICE = (
    "betaflight/LOG00037.BFL",
    "crazypad/motor_data__normal_flight__E8_log00",
    "public-faults/fail-advice-in-vain-esc-4hz.ulg",
    "public-faults/fail-datcon-tick-as-ns.csv",
    "public-faults/fail-payload-hover-shift.bin",
)


class Answers:
    """The replies of somebody who takes what is proposed, and else the first choice."""

    def __init__(self, questions: StringIO) -> None:
        self.questions = questions

    def readline(self) -> str:
        question = self.questions.getvalue().rsplit("\n")[-1]
        known = {"Mass": "0.5", "[mm]": "200", "Magnets": "14"}
        reply = next((words for sign, words in known.items() if sign in question), None)
        if reply is None:
            [choices] = re.findall(r"[(:] ?([^():]+?)\)?(?: \[[^]]*\])?: $", question)
            reply = "" if "[" in question else choices.partition(",")[0]
        return f"{reply}\n"


def output_of(monkeypatch, command: list[str]) -> tuple[int, str]:
    """Run a command with answers; return its exit code and all that it printed."""
    out, err = StringIO(), StringIO()
    monkeypatch.setattr(sys, "stdin", Answers(err))
    with redirect_stdout(out), redirect_stderr(err):
        code = called(*command)
    return code, f"{out.getvalue()}\n{err.getvalue()}"


def commands_in(text: str) -> list[list[str]]:
    """Find the commands that a text names, each as the list of its words after the program."""
    shown = re.sub(r"^(?:Usage|Try|Example)\b.*$", "", text, flags=re.MULTILINE)
    found = (shlex.split(words)[1:] for words in COMMAND.findall(shown))
    return [words for words in found if words[0] in NAMES]


@dataclass(frozen=True, slots=True)
class Ran:
    """A printed command as it ended, without the name of its log in what it printed."""

    command: list[str]
    code: int
    text: str

    @property
    def is_as_promised(self) -> bool:
        """Whether it was accepted, and met neither a missing file nor an open question."""
        return self.code in (0, 1) and not UNRUNNABLE.search(self.text)


def run_printed(monkeypatch, log: Path) -> list[Ran]:
    """Run the first commands with a log, and each command that any output prints: these."""
    waiting = [[name, str(log)] for name in FIRST]
    done: list[list[str]] = []
    printed: list[Ran] = []
    while waiting and len(done) <= MOST:
        command = waiting.pop(0)
        done.append(command)
        code, text = output_of(monkeypatch, command)
        if len(done) > len(FIRST):
            printed.append(Ran(command, code, text.replace(str(log), "")))
        waiting += [new for new in commands_in(text) if new not in done and new not in waiting]
    return printed


def logs_in(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.rglob("*")) if p.is_file() and not LEFT_OUT.search(p.name)]


@pytest.mark.flights
@pytest.mark.parametrize("name", SLICE)
def test_commands_about_a_few_logs_run_as_printed(flight_data_dir, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    printed = run_printed(monkeypatch, flight_data_dir / name)
    assert 1 <= len(printed) <= MOST - len(FIRST)
    assert [ran for ran in printed if not ran.is_as_promised] == []


@pytest.mark.slow
@pytest.mark.flights
def test_commands_about_every_log_run_as_printed(flight_data_dir, tmp_path, monkeypatch):
    printed: dict[str, list[Ran]] = {}
    for number, log in enumerate(logs_in(flight_data_dir)):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        printed[log.name] = run_printed(monkeypatch, log)
    assert [ran for each in printed.values() for ran in each if not ran.is_as_promised] == []
    assert [name for name, each in printed.items() if len(each) > MOST - len(FIRST)] == []
    assert sum(map(len, printed.values())) > len(printed)


def test_commands_about_a_file_of_several_logs_run_as_printed(tmp_path, columns, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "two flights.bbl"
    one = blackbox_of({name: values[::4] for name, values in columns.items()})
    log.write_bytes(one + one)
    code, text = output_of(monkeypatch, ["inspect", str(log)])
    assert (code, commands_in(text)) == (0, [["inspect", str(log), "--log", "1"]])
    _, text = output_of(monkeypatch, commands_in(text)[0])
    named = commands_in(text)
    assert named
    assert all(words[1:4] == [str(log), "--log", "1"] for words in named)
    assert not any(output_of(monkeypatch, words)[0] == 2 for words in named)


def test_a_command_stays_on_one_line():
    command = "rotorfit identify 'a flight.bbl' --log 4 --airframe airframe.toml"
    for width in range(20, 90):
        lines = wrapped(f"describe the vehicle (as a file: {command}), then fly again", width)
        assert sum(command in line for line in lines) == 1
        assert all(len(line) <= width or command in line for line in lines)
