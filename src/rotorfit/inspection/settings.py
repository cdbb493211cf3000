"""Which settings of an autopilot make its next log a better one: what its format advises."""

from collections.abc import Mapping, Set
from pathlib import Path
from types import MappingProxyType
from typing import Final

from rotorfit.logs.firmware import Lack, Setting, advice_for

UNKNOWN: Final[Mapping[str, str]] = MappingProxyType({})


def settings_for(
    log_format: str, lacks: Set[Lack], metadata: Mapping[str, str] = UNKNOWN
) -> tuple[Setting, ...]:
    """Select the settings to change before the next flight, by what the log lacks and has set."""
    advice = advice_for(log_format, lacks, metadata)
    return () if advice is None else advice.settings


def settings_file(log_format: str, metadata: Mapping[str, str] = UNKNOWN) -> Path | None:
    """Return the file that holds the settings of a log's firmware; None where there is none."""
    advice = advice_for(log_format, frozenset(), metadata)
    return None if advice is None else Path(__file__).parent / "settings_files" / advice.file
