"""Choose the settings that make the next log a better one, from the channels of this one."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.firmware import Filter, Lack, Setting, filters_on_board
from rotorfit.logs.flight_log import CHANNELS, FlightLog
from rotorfit.logs.formats import BY_NAME
from rotorfit.tools.inspection.recording import ChannelReport, channel_report, lacks, settings_for

if TYPE_CHECKING:
    from collections.abc import Mapping


@frozen_dataclass
class AdvisedSettings:
    """The settings to change before the next flight, of one log.

    - `file`, `format`, `metadata`: of the log.
    - `log`: which one of how many in its file, such as ``1 of 1``.
    """

    file: str
    format: str
    log: str
    metadata: Mapping[str, str]
    settings: tuple[Setting, ...]

    @property
    def as_argument(self) -> str:
        """The log as a command takes it: its file, and which log of several."""
        return log_as_argument(self.file, self.log)


def log_as_argument(file: str, log: str) -> str:
    """Write a log as a command takes it; `log` is such as ``2 of 5``."""
    number, _, count = log.partition(" of ")
    several = f" --log {number}" if count.isdecimal() and int(count) > 1 else ""
    return f"{shlex.quote(file)}{several}"


def advised_settings(log: FlightLog) -> AdvisedSettings:
    """Choose the settings for a log; its flight itself is not looked at."""
    lacking = lacks_of(channel_reports(log), logged_low_passes(log))
    return AdvisedSettings(
        file=str(log.path),
        format=log.format,
        log=f"{log.log_number} of {log.logs_in_file}",
        metadata=dict(log.metadata),
        settings=settings_for(log.format, lacking, log.metadata),
    )


def channel_reports(log: FlightLog) -> dict[str, ChannelReport]:
    """Measure every channel of a log, in their usual order."""
    return {
        name: channel_report(name, log.channels[name]) for name in CHANNELS if name in log.channels
    }


def lacks_of(reports: Mapping[str, ChannelReport], filters: list[Filter]) -> frozenset[Lack]:
    """List what a log lacks by its channels and the low-passes that they went through."""
    cutoffs = [one.low for one in filters if one.channel == "accel"]
    return lacks(reports, accel_cutoff=min(cutoffs, default=None))


def logged_low_passes(log: FlightLog) -> list[Filter]:
    """Select the low-passes that the samples went through, where the reader's notes do not."""
    form = BY_NAME.get(log.format)
    if form is not None and form.notes_filters:
        return []
    return [one for one in filters_on_board(log) if one.kind == "low-pass" and one.passed]
