"""Texts that users read, kept in tests/golden/words, one file for each file of tests.

    pytest --update-golden tests/FOLDER/test_FILE.py

writes them anew, so that a sentence is reworded in one place; the diff shows what users will read.
"""

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
WORDS = TESTS / "golden" / "words"
HEAD = "=== "
NUMBER = re.compile(r"(?<![\w.^])[-+\u2212]?\d+(?:\.\d+)*(?:e[-+]?\d+)?|(?<=\))e[-+]\d+")
HASH = re.compile(r"(?<=-)[0-9a-f]{8}(?=\.)")
"""Begin of a file's hash in the name of another: simulated logs differ by a machine's rounding."""


def mask_numbers(text: str) -> str:
    """Return a text with its numbers as #, in whatever columns they stood."""
    return re.sub(r" +", " ", NUMBER.sub("#", text))


BLOCKS = re.compile(
    r"\n|</?(?:p|li|ul|td|th|tr|div|h\d|text|tspan|section|figcaption|summary|br)\b[^>]*>"
)


def lines_with(text: str, key: str) -> list[str]:
    """Return the lines of a text, or the paragraphs of a page, in which a key stands."""
    lines = (re.sub(r"<[^>]*>", "", line).strip() for line in BLOCKS.split(text))
    found = [line for line in lines if key in line]
    assert found, f"no line with {key!r}"
    return found


def read_sections(path: Path) -> dict[str, str]:
    """Return the texts of a file of words by their heads."""
    if not path.exists():
        return {}
    parts = re.split(rf"^{HEAD}(.*)\n", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {head: text[:-1] for head, text in zip(parts[1::2], parts[2::2], strict=True)}


def write_sections(path: Path, sections: Mapping[str, str]) -> None:
    """Write texts under their heads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "".join(f"{HEAD}{head}\n{sections[head]}\n" for head in sorted(sections))
    path.write_text(text, encoding="utf-8", newline="\n")


class KeptWords:
    """Compares the texts of one test with the kept ones, in the order in which they come."""

    def __init__(self, test: str, path: Path, places: Mapping[str, str], *, update: bool):
        self.test, self.update, self.places = test, update, places
        self.path = WORDS / path.relative_to(TESTS).with_suffix(".txt")
        self.number = Counter[str]()

    def compare(self, said: str | Iterable[str]) -> None:
        """Fail where a text, or one line for each of several, is not the kept one."""
        self._compare_lines(self._named_places(said))

    def compare_masked(self, said: str | Iterable[str]) -> None:
        """Fail where a text says other words than the kept one, whatever its numbers."""
        self._compare_lines(mask_numbers(self._named_places(said)))

    def _named_places(self, said: str | Iterable[str]) -> str:
        """Return a text in which folders of this machine have names, and hashes are #."""
        text = HASH.sub("#", said if isinstance(said, str) else "\n".join(map(str, said)))
        for place, name in self.places.items():
            text = re.sub(place, name, text)
        return text

    def _compare_lines(self, said: str) -> None:
        text = "\n".join(line.rstrip() for line in said.splitlines())
        self.number[self.test] += 1
        place = self.number[self.test]
        head = self.test if place == 1 else f"{self.test} ({place})"
        sections = read_sections(self.path)
        if self.update:
            write_sections(self.path, {**sections, head: text})
        elif sections.get(head) != text:
            kept = sections.get(head, "").splitlines()
            diff = difflib.unified_diff(kept, text.splitlines(), "kept", "said", lineterm="", n=1)
            lines = "\n".join(diff)
            pytest.fail(f"{head}: meant so? then  pytest --update-golden\n{lines}", pytrace=False)
