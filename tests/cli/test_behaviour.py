"""How the program behaves around its answers: outputs, interruptions, names, locales, faults."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from benchmarks.common import without_progress
from blackbox_file import blackbox_of
from command_line import EXPERIMENT

from rotorfit import __version__
from rotorfit.cli import terminal
from rotorfit.cli.main import main
from rotorfit.cli.terminal import COLOUR, colour_from, coloured, paced, steps
from rotorfit.errors import EstimationError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs import read_log
from rotorfit.report.summary import summary_text
from rotorfit.results.result import IdentificationResult

PROGRAM = Path(sys.executable).with_name("rotorfit")
LOG = ("flight.csv", "--mass", "1.285", "--airframe", "airframe.toml")


def installed(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the installed program as a user does."""
    ended = subprocess.run(
        [PROGRAM, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "80", **environment},
        timeout=600,
        check=False,
    )
    ended.stderr = without_progress(ended.stderr)
    return ended


@pytest.fixture(scope="module")
def saved(tmp_path_factory, table_text) -> Path:
    """A folder with an experiment, and its result as the installed program wrote it."""
    folder = tmp_path_factory.mktemp("saved")
    (folder / "flight.csv").write_text(table_text)
    (folder / "experiment.toml").write_text(EXPERIMENT)
    ended = installed("identify", f"{folder}/experiment.toml", "-o", f"{folder}/result.json")
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == f"wrote {folder}/result.json\n"
    (folder / "printed.txt").write_text(ended.stdout)
    return folder


def numbers(result: dict) -> dict:
    """Return everything of a result that does not depend on where its files are."""
    return {key: result[key] for key in ("parameters", "derived", "covariance", "diagnostics")}


def stored(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


# -- results -------------------------------------------------------------------------------------


def test_the_result_loads_and_prints_the_same(saved):
    result = IdentificationResult.load(saved / "result.json")
    assert result.parameter("kt").value == pytest.approx(3.63e-6, rel=0.03)
    assert summary_text(result, width=80) == (saved / "printed.txt").read_text()


def test_the_same_from_another_folder_as_json_and_twice(run, saved, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = run("identify", os.path.relpath(saved / "experiment.toml"), "--json")
    assert (ended.code, ended.err) == (0, "")
    assert numbers(ended.json) == numbers(stored(saved))


def test_names_with_blanks_and_umlauts(run, saved, tmp_path, monkeypatch):
    folder = tmp_path / "Prüf stand 飛行"
    folder.mkdir()
    (folder / "flug ä.csv").write_bytes((saved / "flight.csv").read_bytes())
    text = EXPERIMENT.replace("flight.csv", "flug ä.csv")
    (folder / "versuch ö.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    ended = run("identify", folder / "versuch ö.toml", "-o", folder / "ergebnis ß.json")
    assert ended.code == 0
    written = json.loads((folder / "ergebnis ß.json").read_text(encoding="utf-8"))
    assert numbers(written) == numbers(stored(saved))
    assert written["flights"][0]["file"] == "flug ä.csv"
    (settings,) = written["settings"]["configuration"]
    assert Path(settings["flights"][0]["file"]) == folder / "flug ä.csv"


def test_force_replaces(run, saved, here):
    (here / "result.json").write_text("mine")
    assert run("identify", "experiment.toml", "-o", "result.json", "--force").code == 0
    assert numbers(stored(here)) == numbers(stored(saved))


@pytest.fixture
def broken(monkeypatch) -> Callable[[str, str, BaseException], None]:
    """Let an operation of `Path` on the files of a name fail."""

    def break_disk(operation: str, name: str, fault: BaseException) -> None:
        whole = getattr(Path, operation)

        def faulty(self, *arguments, **options):
            if self.name.startswith(name):
                raise fault
            return whole(self, *arguments, **options)

        monkeypatch.setattr(Path, operation, faulty)

    return break_disk


def test_a_failing_disk_leaves_nothing(refused, here, broken):
    broken("replace", "", OSError(28, "No space left on device"))
    line = refused("identify", "experiment.toml", "-o", "result.json")
    assert "No space left on device" in line


# -- options -------------------------------------------------------------------------------------


def test_start_and_end_are_those_of_the_experiment_file(run, here):
    given = run("identify", *LOG, "--method", "ols", "--start", "6", "--end", "20", "--json")
    flight = '{ file = "flight.csv", start = 6.0, end = 20.0 }'
    (here / "experiment.toml").write_text(EXPERIMENT.replace('"flight.csv"', flight))
    written = run("identify", "experiment.toml", "--json")
    assert (given.code, written.code) == (0, 0)
    assert numbers(given.json) == numbers(written.json)
    assert given.json["flights"][0]["used"][0] == pytest.approx([6.0, 20.0], abs=0.02)


def test_one_of_several_logs_is_identified(run, refused, here, columns):
    ground = blackbox_of({name: values[:400] for name, values in columns.items()})
    (here / "two.bbl").write_bytes(ground + blackbox_of(columns))
    (here / "one.bbl").write_bytes(blackbox_of(columns))
    options = ("--mass", "1.285", "--airframe", "airframe.toml", "--method", "ols", "--json")
    message = refused("identify", "two.bbl", *options)
    assert "holds 2 logs (2: " in message and "(--log" in message
    chosen = run("identify", "two.bbl", "--log", "2", *options)
    flight = '{ file = "two.bbl", log = 2 }'
    (here / "experiment.toml").write_text(EXPERIMENT.replace('"flight.csv"', flight))
    written = run("identify", "experiment.toml", "--json")
    alone = run("identify", "one.bbl", *options)
    assert (chosen.code, written.code, alone.code) == (0, 0, 0)
    assert numbers(chosen.json) == numbers(alone.json)
    assert numbers(chosen.json) == numbers(written.json)


def test_the_other_log_of_a_file_validates(run, refused, here, columns):
    later = {**columns, "time": columns["time"] + 100.0}
    (here / "two.bbl").write_bytes(blackbox_of(columns) + blackbox_of(later))
    options = ("--mass", "1.285", "--airframe", "airframe.toml", "--method", "ols")
    assert run("identify", "two.bbl", "--log", "1", *options, "-o", "one.json").code == 0
    other = run("validate", "one.json", "two.bbl", "--log", "2", "--json")
    assert other.code == 0
    assert [row["flight"] for row in other.json] == ["two.bbl"]
    assert "used in the fit" in refused("validate", "one.json", "two.bbl", "--log", "1")
    nameless = run("fly", "one.json", "--log", "2")
    assert (nameless.code, "--log needs a --flight" in nameless.err) == (2, True)


def test_speed_overrides_the_file(run, changed, here):
    changed(lambda c: {n: v for n, v in c.items() if not n.startswith("rotor_")})
    given = run("identify", "experiment.toml", "--speed", "commanded", "--json")
    motors = '[motors]\nspeed = "commanded"\n'
    (here / "experiment.toml").write_text(EXPERIMENT + motors)
    written = run("identify", "experiment.toml", "--json")
    assert given.code == written.code
    assert given.code == 1 or numbers(given.json) == numbers(written.json)


def test_measured_speed_needs_no_law(run, saved, here):
    motors = '[motors]\nspeed = "commanded"\nlag = 0.04\nlaw = { polynomial = [0.0, 1500.0] }\n'
    (here / "experiment.toml").write_text(EXPERIMENT + motors)
    ended = run("identify", "experiment.toml", "--speed", "measured", "--json")
    assert ended.code == 0
    assert numbers(ended.json) == numbers(stored(saved))


# -- interrupted, unread, at fault ---------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe with a name")
def test_ctrl_c(tmp_path):
    log = tmp_path / "slow.csv"
    os.mkfifo(log)
    running = subprocess.Popen(
        [PROGRAM, "inspect", log],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # The tests may themselves run in the background, where a shell has this signal ignored.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    writer = os.open(log, os.O_WRONLY)  # waits until the program reads, which then waits for us
    time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=600)
    os.close(writer)
    assert (running.returncode, out) == (130, "")
    assert without_progress(err) == "rotorfit: stopped\n"


def inspected_into(stdout, saved):
    ended = subprocess.run(
        [PROGRAM, "inspect", saved / "flight.csv"],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        timeout=600,
        check=False,
    )
    ended.stderr = without_progress(ended.stderr)
    return ended


def test_nobody_reads_on(saved):
    """As in  rotorfit inspect ... | head -1, with a reader that is gone at once."""
    reader, writer = os.pipe()
    os.close(reader)
    ended = inspected_into(writer, saved)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_under_what_is_printed_is_no_fault_of_ours(saved, assert_wording):
    with Path("/dev/full").open("w") as full:
        ended = inspected_into(full, saved)
    assert ended.returncode == 1
    assert_wording(ended.stderr)
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("fault", [ValueError("odd\nvalue"), MemoryError(), RecursionError("deep")])
def test_a_fault_of_ours_is_one_line(refused_fault, fault, assert_text):
    line = refused_fault(fault)
    words = f"{type(fault).__name__}: {' '.join(str(fault).split())}".removesuffix(": ")
    assert f"({words})" in line
    assert_text(line)


def test_equations_without_a_solution_are_refused(here):
    def unsolved(step: str):
        raise np.linalg.LinAlgError("SVD did not converge")

    experiment = load_experiment(here / "experiment.toml")
    with pytest.raises(EstimationError, match=r"no solution \(SVD did not converge\)"):
        identify(experiment, progress=unsolved)


@pytest.fixture
def refused_fault(run, here, monkeypatch, broken):
    def line(fault: Exception) -> str:
        monkeypatch.delenv("ROTORFIT_DEBUG", raising=False)
        broken("read_text", "experiment.toml", fault)
        ended = run("identify", "experiment.toml")
        assert (ended.code, ended.out) == (1, "")
        return ended.err

    return line


def test_debugging_shows_the_fault(here, monkeypatch, broken):
    broken("read_text", "experiment.toml", ValueError("odd value"))
    monkeypatch.setenv("ROTORFIT_DEBUG", "1")
    with pytest.raises(ValueError, match="odd value"):
        main(["identify", "experiment.toml"])


def test_ctrl_c_in_process(run, here, broken):
    broken("open", "flight.csv", KeyboardInterrupt())
    ended = run("identify", "experiment.toml", "-o", "result.json")
    assert (ended.code, ended.out, ended.err) == (130, "", "rotorfit: stopped\n")
    assert not (here / "result.json").exists()


# -- surroundings --------------------------------------------------------------------------------


def test_python_m_and_version():
    for command in ([str(PROGRAM)], [sys.executable, "-m", "rotorfit"]):
        ended = subprocess.run(
            [*command, "--version"], capture_output=True, text=True, timeout=600, check=True
        )
        assert (ended.stdout, ended.stderr) == (f"rotorfit {__version__}\n", "")


def test_ascii_terminal_and_warnings_as_errors(saved, tmp_path, assert_wording):
    """A C locale, and a Python that takes every warning for an error."""
    folder = tmp_path / "Höhe"
    folder.mkdir()
    (folder / "flight.csv").write_bytes((saved / "flight.csv").read_bytes())
    text = EXPERIMENT.replace("[airframe]", 'name = "Höhe"\n[airframe]', 1)
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    surroundings = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONWARNINGS": "error"}
    ended = installed("identify", f"{folder}/experiment.toml", **surroundings)
    assert (ended.returncode, ended.stderr) == (0, "")
    printed = (saved / "printed.txt").read_text()
    expected = printed.replace("experiment:", "H\\xf6he:", 1)
    assert ended.stdout.split() == expected.split()  # a longer name, wrapped elsewhere
    ended = installed("inspect", f"{folder}/none.csv", **surroundings)
    assert ended.returncode == 1
    assert "H\\xf6he/none.csv: no" in ended.stderr
    assert_wording(ended.stderr)


def test_plain_lines_where_stderr_is_no_terminal():
    stream = io.StringIO()
    with redirect_stderr(stream), steps(every=0.02) as report_progress:
        report_progress("fitting")
        while stream.getvalue().count("\n") < 2:
            time.sleep(0.01)
    lines = stream.getvalue().splitlines()
    assert all(re.fullmatch(r"rotorfit: \S.* \(\d+ s so far\)", line) for line in lines)
    assert re.match(r"rotorfit: fitting \(", lines[-1])


def awaited(words, stream):
    """Wait until a line says so, and return all that was said until then."""
    for _ in range(1000):
        if words in stream.getvalue():
            break
        time.sleep(0.01)
    return stream.getvalue()


def test_a_pace_is_until_now_not_until_the_last_log():
    """One log that hangs must not leave "about 9 s left" standing for minutes."""
    seconds = [0.0]
    stream = io.StringIO()
    with (
        redirect_stderr(stream),
        paced("identifying", every=0.02, clock=lambda: seconds[0]) as report_progress,
    ):
        seconds[0] = 1.0
        report_progress(10, 100)
        pace = "10 of 100, 10.0 a second, about 9 s left"
        assert pace in awaited(pace, stream)
        seconds[0] = 20.0
        pace = "10 of 100, 0.5 a second, about 3 min left"
        assert pace in awaited(pace, stream)


@pytest.mark.parametrize(
    ("when", "variables", "expected"),
    [
        ("auto", {}, True),
        ("auto", {"NO_COLOR": "1"}, False),
        ("auto", {"TERM": "dumb"}, False),
        ("never", {}, False),
        ("always", {"NO_COLOR": "1"}, True),
    ],
)
def test_verdicts_in_colour_on_a_terminal(monkeypatch, when, variables, expected):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    text = (
        "  kt   3 +- 1  N  identified\n  kd   -   N m  ratio-only with Izz\n"
        "  lag  3 +- 1 (doubtful), words\n  com_x (weak): words\n  identified: words"
    )
    rest = colour_from(["identify", "--color", when, "log.csv"])
    assert rest == ["identify", "log.csv"]
    green, yellow = "\x1b[32midentified\x1b[0m\n", "\x1b[33mratio-only\x1b[0m with Izz\n"
    with redirect_stdout(Terminal()):
        shown = coloured(text)
    COLOUR.set("auto")
    red = "3 +- 1 (\x1b[31mdoubtful\x1b[0m), words\n  com_x (weak): words"
    assert [part in shown for part in (green, yellow, red)] == [expected] * 3
    assert shown.endswith("  identified: words")
    assert re.sub(r"\x1b\[\d+m", "", shown) == text


def test_a_colour_that_is_none_is_refused(refused, here, assert_wording):
    assert_wording(refused("inspect", "--color=red"))


def test_prose_is_as_wide_as_the_terminal(run, here, monkeypatch):
    for columns, widest in (("72", 72), ("300", 100)):
        monkeypatch.setenv("COLUMNS", columns)
        text = run("inspect", "flight.csv").out
        assert 60 < max(map(len, text.splitlines())) <= widest


def test_a_target_that_is_misspelt_is_named(run, here, assert_wording):
    ended = run("export", "result.json", "--to", "gazbo", "-o", "x")
    assert ended.code == 2
    assert_wording(" ".join(ended.err.split()))


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_of_commands_and_targets(shell):
    """As typer's scripts ask for it: the words so far, and which of them is being typed."""
    word = {"bash": "rotorfit export --to ga", "zsh": "rotorfit export --to ga",
            "fish": "rotorfit export --to ga"}[shell]  # fmt: skip
    surroundings = {
        **os.environ,
        "_ROTORFIT_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": word,
        "COMP_CWORD": "3",
        "_TYPER_COMPLETE_ARGS": word,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    ended = subprocess.run(
        [sys.executable, "-c", "from rotorfit.cli.main import main; main()"],
        env=surroundings, capture_output=True, text=True,
    )  # fmt: skip
    assert "gazebo-motors" in ended.stdout, ended
    assert "mujoco" not in ended.stdout


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def wait_for(pattern, stream):
    """Wait until a terminal shows it: a thread draws there, when the machine lets it."""
    while stream.isatty() and not re.search(pattern, stream.getvalue()):
        time.sleep(0.01)


def test_progress_only_where_someone_watches():
    for stream, shown in ((io.StringIO(), False), (Terminal(), True)):
        with redirect_stderr(stream), steps(every=3600.0) as report_progress:
            report_progress("reading flight.csv")
            wait_for("reading flight.csv", stream)
        assert ("reading flight.csv" in stream.getvalue()) == shown


BAR = r"\u2501.*reading long.csv, [1-9]\d %"


def halfway(stream, done):
    """Wait for the bar where there is one to see."""
    if 0.3 < done < 0.9:
        wait_for(BAR, stream)


def test_a_log_has_a_bar_where_someone_watches(monkeypatch, tmp_path):
    monkeypatch.setenv("TERM", "xterm")
    rows = "\n".join(f"{0.01 * i:.2f},{i % 7},2,3" for i in range(300_000))  # several pieces
    log = tmp_path / "long.csv"
    log.write_text("time,gyro_x,gyro_y,gyro_z\n" + rows)
    for stream, shown in ((io.StringIO(), False), (Terminal(), True)):
        with redirect_stderr(stream), steps(every=3600.0) as report_progress:
            report_progress("looking")
            read_log(log, progress=partial(halfway, stream))
        words = stream.getvalue()
        assert ("reading long.csv" in words) == shown
        assert (re.search(BAR, words) is not None) == shown


def test_modules_load_behind_a_sign_of_life(monkeypatch):
    for stream, shown in ((io.StringIO(), False), (Terminal(), True)):
        loaded: list[str] = []

        def load_slowly(name: str, stream=stream, loaded=loaded) -> None:
            wait_for("starting", stream)
            loaded.append(name)

        monkeypatch.setattr(terminal, "import_module", load_slowly)
        with redirect_stderr(stream):
            terminal.load_modules("slow.to.import")
        assert loaded == ["slow.to.import"]
        assert ("starting" in stream.getvalue()) == shown
