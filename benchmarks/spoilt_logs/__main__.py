"""The command line of the study."""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import benchmarks.spoilt_logs as study
from benchmarks.common import SOUND
from benchmarks.spoilt_logs.cases import CASES, Spoilt
from benchmarks.spoilt_logs.outcomes import HEAD, KEPT, Said, all_told, page_table, path_steps, row
from benchmarks.spoilt_logs.windows import window_faults

BEGIN: Final = "<!-- made by python -m benchmarks.spoilt_logs --page docs/spoilt-logs.md -->"
END: Final = "<!-- end -->"


def main() -> None:
    options = _parser().parse_args()
    if options.keep:
        KEPT["folder"] = options.keep.resolve()
    cases = [case for case in CASES if options.only in case.name]
    told: list[tuple[Spoilt, Said]] = []
    lines: Iterator[str] = _rows(cases, options.workers, told)
    if options.windows:
        lines = window_faults(options.windows, options.seed, options.only)
    elif options.path:
        lines = (path_steps(log) for log in SOUND if options.only in log)
    written: list[str] = []
    for line in lines:
        print(line, flush=True)
        written.append(line)
    if options.output:
        options.output.write_text("\n".join(written) + "\n", encoding="utf-8")
    if options.page:
        options.page.write_text(_with_table(options.page, page_table(told)), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=str(study.__doc__).splitlines()[0])
    parser.add_argument("--only", default="", help="cases with this in their name")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="leave experiments, tables and results here")
    parser.add_argument(
        "--path", action="store_true", help="only show that the path spoils nothing"
    )
    parser.add_argument("--windows", type=float, default=0.0, help="seconds of random windows")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--page", type=Path, help="write the table into this page of docs/")
    return parser


def _rows(cases: Sequence[Spoilt], workers: int, told: list[tuple[Spoilt, Said]]) -> Iterator[str]:
    """Yield the rows of the table, as they come, and note what was told."""
    yield HEAD
    for case, said in all_told(cases, workers):
        told.append((case, said))
        yield row(case, said)


def _with_table(page: Path, table: str) -> str:
    """Return a page with another table between its marks."""
    text = page.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{table}\n\n{END}{after}"


if __name__ == "__main__":
    main()
