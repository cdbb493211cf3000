"""--help answers at once: what is heavy is imported by the command that needs it."""

import os
import subprocess
import sys

import pytest

HEAVY = {"numpy", "scipy", "pydantic", "jaxtyping", "rich", "jinja2", "pyarrow", "threadpoolctl"}
PROBE = """
import sys
sys.argv = ["rotorfit", *{arguments!r}]
from rotorfit.cli.main import main
try:
    main()
except SystemExit as ended:
    code = ended.code or 0
print("\\nimported", *{{name.split(".")[0] for name in sys.modules}})
sys.exit(code)
"""


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (("--help",), set[str]()),
        (("--version",), set[str]()),
        # Newer releases of typer check options with pydantic.
        (("identify", "--help"), {"pydantic"}),
        (("demo", "--help"), {"pydantic"}),
    ],
)
def test_nothing_heavy_is_imported(arguments, allowed):
    probe = PROBE.format(arguments=arguments)
    ended = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, timeout=600, check=True
    )
    imported = set(ended.stdout.rsplit("imported", maxsplit=1)[1].split())
    assert "typer" in imported
    assert imported & HEAVY <= allowed


def test_a_window_too_short_is_refused_before_the_log_is_read(tmp_path):
    log = tmp_path / "flight.csv"
    log.write_text("time\n0\n1\n")
    options = ("--mass", "1", "--airframe", "a.toml", "--start", "5", "--end", "5.5")
    probe = PROBE.format(arguments=("identify", str(log), *options))
    ended = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, timeout=600, check=False
    )
    assert ended.returncode == 1
    assert "0.5 s of flight" in ended.stderr
    imported = set(ended.stdout.rsplit("imported", maxsplit=1)[1].split())
    assert not imported & (HEAVY - {"pydantic", "rich"})


def processor_seconds(*command: str) -> float:
    before = os.times()
    subprocess.run(command, capture_output=True, check=True)
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])  # of children


def test_help_takes_little_more_than_the_library_behind_it():
    """A ratio of two starts on the same machine, whatever else it does; seconds: benchmarks/."""
    library = [sys.executable, "-c", "import typer.main"]
    helped = [sys.executable, "-m", "rotorfit", "--help"]
    starts = [(processor_seconds(*library), processor_seconds(*helped)) for _ in range(4)]
    least_library, least_helped = (min(column) for column in zip(*starts, strict=True))
    assert least_helped < 4.0 * least_library
