"""A short run of benchmarks/fuzz.py, and proof that it finds what it looks for."""

import random
import warnings

import pytest
from benchmarks.fuzz import DAMAGES, attempt, damaged, fuzz

from rotorfit.errors import LogError


@pytest.mark.slow
def test_no_reader_fails_on_damaged_files(tmp_path):
    assert fuzz(None, seconds=3.0, seed=random.randrange(10**6), findings=tmp_path / "f") == 0


def test_a_short_run_of_a_reader(tmp_path, capsys):
    assert fuzz(["trajectory"], seconds=1.0, seed=5, findings=tmp_path / "f") == 0
    name, _, executions, read, refused = capsys.readouterr().out.splitlines()[1].split()[:5]
    assert name == "trajectory"
    assert int(read) > 0
    assert int(refused) > 0
    assert int(read) + int(refused) == int(executions)


def refuse(path):
    raise LogError("refused: try another")


def refuse_without_words(path):
    raise LogError("")


def fail(path):
    raise ValueError("a fault")


def warn(path):
    warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)


def hang(path):
    while True:
        pass


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (refuse, "refused"),
        (refuse_without_words, "a LogError without words"),
        (fail, "ValueError: a fault"),
        (warn, "RuntimeWarning: divide by zero"),
        (hang, "too slow: more than 0.2 s of the processor"),
        (lambda path: None, "returned NoneType"),
    ],
)
def test_what_breaks_the_promise_is_seen(tmp_path, read, words):
    assert words in attempt(tmp_path / "input", read, seconds=0.2)


def test_every_damage_changes_the_bytes():
    rng = random.Random(1)
    data, other = rng.randbytes(5000), rng.randbytes(3000)
    for damage in DAMAGES:
        assert any(damage(data, other, rng) != data for _ in range(5)), damage
    assert all(damaged([data], [other], rng) for _ in range(100))
