"""--help answers at once: what is heavy is imported by the command that needs it."""

import subprocess
import sys
import time

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
        [sys.executable, "-c", probe], capture_output=True, text=True, timeout=60, check=True
    )
    imported = set(ended.stdout.rsplit("imported", maxsplit=1)[1].split())
    assert "typer" in imported
    assert imported & HEAVY <= allowed


def seconds(*command: str) -> float:
    start = time.perf_counter()
    subprocess.run(command, capture_output=True, timeout=60, check=True)
    return time.perf_counter() - start


def test_help_takes_little_more_than_the_library_behind_it():
    """A ratio of two starts on the same machine, whatever else it does; seconds: benchmarks/."""
    library = min(seconds(sys.executable, "-c", "import typer.main") for _ in range(5))
    helped = min(seconds(sys.executable, "-m", "rotorfit", "--help") for _ in range(5))
    assert helped < 4.0 * library
