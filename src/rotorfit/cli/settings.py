"""rotorfit settings: what to change before the next flight, as a file made for this log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Force,
    LogNumber,
    print_result,
    print_status,
    refuse_output_file,
    steps,
)
from rotorfit.errors import LogError

if TYPE_CHECKING:
    from rotorfit.tools.inspection.advised_settings import AdvisedSettings


def settings(
    log_file: Annotated[Path, typer.Argument(metavar="LOG", help="A flight log of an autopilot.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Write what changes here: parameters to load, or lines for the CLI.",
        ),
    ] = None,
    log: LogNumber = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write the settings that make the next log a better one.

    From the values that this log has: only what must change, as old and new. The advice is that of
    inspect.
    """
    from rotorfit.logs.files import write_whole
    from rotorfit.tools.inspection.settings_to_change import file_of, file_text, to_write

    if output is not None:
        refuse_output_file(output, inputs=[log_file], force=force)
    report = _read_advised_settings(log_file, log)
    if file_of(report) is None:
        raise LogError(
            f"{log_file}: rotorfit knows no settings of what wrote this {report.format}: "
            "PX4, ArduPilot, Betaflight, INAV and Crazyflie have some"
        )
    print_result(_settings_json(report) if as_json else _settings_text(report))
    if output is None:
        return
    if to_write(report):
        write_whole(output, file_text(report), force=force)
        print_status(f"rotorfit: wrote {output}")
    else:
        print_status(f"rotorfit: {output} not written: nothing to change")


def _read_advised_settings(path: Path, number: int | None) -> AdvisedSettings:
    from rotorfit.logs import ReadOptions, read_log
    from rotorfit.tools.inspection.advised_settings import advised_settings

    with steps() as report_progress:
        report_progress(f"reading {path.name}")
        log = read_log(path, options=ReadOptions(log_number=number))
    return advised_settings(log)


def _settings_json(report: AdvisedSettings) -> str:
    plain = [
        {"name": s.name, "old": s.old, "new": s.new, "value": s.value, "why": s.why}
        for s in report.settings
    ]
    return json.dumps({"file": report.file, "settings": plain}, indent=1, allow_nan=False)


def _settings_text(report: AdvisedSettings) -> str:
    from rotorfit.tools.inspection.settings_to_change import (
        decision_lines,
        diff_lines,
        file_of,
        to_write,
    )

    count = len(to_write(report))
    words = f"{count or 'nothing'} to change"
    firmware = report.metadata.get("Firmware revision", report.format)
    lines = [f"{report.file}: {firmware}: {words}", *(f"  {line}" for line in diff_lines(report))]
    decisions = decision_lines(report)
    lines += ["for you to decide:", *(f"  {line}" for line in decisions)] if decisions else []
    if count:
        lines.append(f"as a file: rotorfit settings {report.as_argument} -o {file_of(report)}")
    return "\n".join(lines)
