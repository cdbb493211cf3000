"""The tables of flights with an independent truth: what they say follows from what they show."""

import re
from pathlib import Path

import pytest
from benchmarks.evidence import holds, replaced
from benchmarks.stopwatch import CASES

ROOT = Path(__file__).parents[2]
POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻−", "0123456789--")


def block(page: Path, name: str) -> str:
    text = page.read_text(encoding="utf-8")
    return text.split(f"<!-- {name} -->")[1].split(f"<!-- end of {name} -->")[0]


def cells(table: str) -> list[list[str]]:
    lines = [line for line in table.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in rows if row[0] not in ("number", "flight", "---")]


def numbers(text: str) -> list[float]:
    """Return the numbers of a cell, with its power of ten."""
    text = text.translate(POWERS)
    found = []
    for part in text.split(" to "):
        power = re.search(r"× 10(-?\d+)", part)
        scale = 10.0 ** int(power[1]) if power else 1.0
        plain = re.sub(r"× 10-?\d+", "", part)
        found += [float(n) * scale for n in re.findall(r"-?\d+\.?\d*", plain)]
    return found


ROWS = {
    "real flight": [
        (row[0], row[3], row[1], row[4].startswith("yes"))
        for row in cells(block(ROOT / "README.md", "real flight"))
    ],
    "scoreboard": [
        (row[0], row[1], row[2], row[4] == "yes")
        for row in cells(block(ROOT / "docs" / "evidence.md", "scoreboard"))
        if row[0].startswith("`") and row[4] != "–"
    ],
}


@pytest.mark.parametrize("table", ROWS)
def test_inside_says_what_the_numbers_show(table):
    assert len(ROWS[table]) >= 7
    for name, true, interval, inside in ROWS[table]:
        if "(" in interval and " to " in interval:
            continue  # not even about its value: written as value and two ends
        value, half = numbers(interval)
        span = numbers(true)
        slack = 0.02 * half  # of rounding
        assert holds(value, half + slack * (1 if inside else -1), (span[0], span[-1])) == inside, (
            name
        )


def test_counts_are_those_of_the_tables_below():
    page = block(ROOT / "docs" / "evidence.md", "scoreboard")
    summary, *tables = page.split("\n### ")
    counts = {row[0]: (int(row[2]), row[3]) for row in cells(summary)}
    for table in tables:
        name = table.splitlines()[0]
        given = [row for row in cells(table) if row[4] != "–"]
        held = sum(row[4] == "yes" for row in given)
        assert counts.pop(name) in ((len(given), f"{held} of {len(given)}"), (0, "refused"))
    assert counts == {}


def test_only_the_marked_part_of_a_page_is_replaced():
    page = "a\n<!-- x -->\nold\n<!-- end of x -->\nb\n"
    new = replaced(page, "x", "| new |")
    assert new == "a\n<!-- x -->\n\n| new |\n\n<!-- end of x -->\nb\n"
    assert replaced(new, "x", "| new |") == new
    with pytest.raises(SystemExit, match="markers"):
        replaced(page, "y", "")


def test_the_stopwatch_has_the_logs_of_its_table():
    """Log, questions answered, seconds: rows of `python -m benchmarks.stopwatch`, in its order."""
    page = (ROOT / "docs" / "first-parameters.md").read_text(encoding="utf-8")
    shown = [row for row in cells(page.split("## What made one stop")[0]) if row[0] != "log"]
    assert [re.search(r"`(.*?)`", row[0])[1] for row in shown] == [
        Path(case.log).name for case in CASES.values()
    ]
    assert [int(row[1][0]) for row in shown] == [len(case.answers) for case in CASES.values()]
    assert all(re.fullmatch(r"[\d.]+ \+ [\d.]+", row[3]) for row in shown)
