"""Fixtures shared by all tests."""

import gc
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import hypothesis
import jaxtyping
import pytest
from threadpoolctl import threadpool_limits

import first_calls
from kept_words import KeptWords

# The workers share the cores: one thread each, for the processes they start too.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
threadpool_limits(limits=1)  # of numpy, which a plugin has loaded already

# How long an example takes says nothing on a busy machine.
hypothesis.settings.register_profile(
    "timeless", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("timeless")

MOST_WORKERS = 8  # of 0.6 GB at most
SELDOM = (20_000, 10, 10)  # allocations before a collection; at 700 they take 4 to 9 % of the time

jaxtyping.config.update("jaxtyping_disable", True)  # until the first of first_calls.TYPED begins


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return a worker for each core for folders; none for files and single tests."""
    if any(not Path(argument).is_dir() for argument in config.args):
        return 0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(cores or 1, MOST_WORKERS)


def real_logs_folder() -> Path:
    """Return $ROTORFIT_DATA, or ../shared/data beside the repository."""
    default = Path(__file__).parents[2] / "shared" / "data"
    return Path(os.environ.get("ROTORFIT_DATA") or default)


@pytest.fixture(scope="session")
def flight_data_dir() -> Path:
    """Folder of the real logs: $ROTORFIT_DATA, or ../shared/data beside the repository."""
    folder = real_logs_folder()
    if not folder.is_dir():
        pytest.skip(f"no flight data in {folder}: set ROTORFIT_DATA")
    return folder


@pytest.fixture(scope="module", autouse=True)
def one_step_a_sample() -> Iterator[None]:
    """Integrate simulated flights in one step a sample, in half of the time that two take.

    Rates and specific forces are within 1e-7 of theirs in two; `tests/simulation` takes two.
    """
    from rotorfit.simulation.flight import Scenario

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Scenario.__dataclass_fields__["physics_rate"], "default", 200.0)
        yield


@pytest.fixture(autouse=True)
def no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """Print no progress between two lines of a command, however busy the machine is."""
    monkeypatch.setattr("rotorfit.cli.terminal.EVERY", 1e6)


def pytest_collection_finish() -> None:
    """Let the collector of garbage pass over what stays to the end: modules and collected tests."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*SELDOM)


def pytest_runtest_setup(item: pytest.Item) -> None:
    first_calls.check_all_again()
    jaxtyping.config.update("jaxtyping_disable", not first_calls.is_typed(item.path))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write the golden files anew")
    parser.addoption("--update-pictures", action="store_true", help="take the screenshots anew")


@pytest.fixture
def golden(request: pytest.FixtureRequest):
    """Return what a file of tests/golden holds; with --update-golden a text is written there."""
    folder = Path(__file__).parent / "golden"

    def expected(name: str, text: str) -> str:
        path = folder / name
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
        if not path.exists():
            pytest.fail(f"no {path}: make it with  pytest --update-golden")
        kept = path.read_text(encoding="utf-8")
        if kept != text:
            request.node.add_report_section("call", name, "meant so? then  pytest --update-golden")
        return kept

    return expected


@pytest.fixture
def kept_words(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """Return what compares the texts of a test with those of tests/golden/words."""
    places = {
        rf"{re.escape(str(tmp_path_factory.getbasetemp()))}(/[^/\s]+)?": "TMP",
        re.escape(str(Path(__file__).parents[1])): "REPOSITORY",
        re.escape(str(real_logs_folder())): "DATA",
    }
    update = request.config.getoption("--update-golden")
    return KeptWords(request.node.name, request.path, places, update=update)


@pytest.fixture
def assert_text(kept_words: KeptWords) -> Callable[[str | Iterable[str]], None]:
    """Compare a text, or several, with the kept one, number by number."""
    return kept_words.compare


@pytest.fixture
def assert_wording(kept_words: KeptWords) -> Callable[[str | Iterable[str]], None]:
    """Compare a text, or several, with the kept one, whatever the numbers."""
    return kept_words.compare_masked
