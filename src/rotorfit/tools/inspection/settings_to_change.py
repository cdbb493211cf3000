"""The settings that one log asks to change, from its own values: as old and new, and as a file.

What `inspect` advises is written here in the form that the autopilot loads; a setting whose value
only the owner knows is a comment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

from rotorfit.logs.files import file_name
from rotorfit.tools.inspection.recording import settings_file

if TYPE_CHECKING:
    from rotorfit.logs.firmware import Setting
    from rotorfit.tools.inspection.advised_settings import AdvisedSettings

Line = Callable[[str, str], str]
WHOLE_LINE: Final = ":"
"""Ends the name of a setting whose value is a whole line of the file or the CLI."""


def _px4_line(name: str, value: str) -> str:
    return f"1\t1\t{name}\t{value}\t6"


def _ardupilot_line(name: str, value: str) -> str:
    return f"{name},{value}"


def _command_line(name: str, value: str) -> str:
    return f"set {name} = {value}"


def _card_line(name: str, value: str) -> str:
    return value


LINES: Final[dict[str, tuple[Line, tuple[str, ...]]]] = {
    "px4.params": (_px4_line, ()),
    "ardupilot.parm": (_ardupilot_line, ()),
    "betaflight.txt": (_command_line, ("# Write and restart.", "save")),
    "inav.txt": (_command_line, ("# Write and restart.", "save")),
    "config.txt": (_card_line, ()),
}
"""How a file of each autopilot writes a setting, and how it ends."""


def file_of(report: AdvisedSettings) -> str | None:
    """Return the name of the kind of file that the log's autopilot loads; None for other logs."""
    path = settings_file(report.format, report.metadata)
    return None if path is None else path.name


def to_write(report: AdvisedSettings) -> tuple[Setting, ...]:
    """Select the settings whose new value is known."""
    return tuple(setting for setting in report.settings if setting.new is not None)


def to_decide(report: AdvisedSettings) -> tuple[Setting, ...]:
    """Select the settings whose value only the owner of the vehicle knows."""
    return tuple(setting for setting in report.settings if setting.new is None)


def diff_lines(report: AdvisedSettings) -> list[str]:
    """Return old and new of every setting that must change, as a diff, with the reasons."""
    out: list[str] = []
    for setting in to_write(report):
        if setting.old is not None:
            out.append(f"-{_setting_line(report, setting, setting.old)}")
        out += [
            f"+{_setting_line(report, setting, setting.new or '')}",
            f"   {_explain_setting(setting)}",
        ]
    return out


def decision_lines(report: AdvisedSettings) -> list[str]:
    """Return a line for each setting that the owner must decide."""
    return [
        f"{s.name}{'' if s.old is None else f' (now {s.old})'}: {s.value}: {s.why}"
        for s in to_decide(report)
    ]


def file_text(report: AdvisedSettings) -> str:
    """Return the file that changes what must change and nothing else."""
    file = file_of(report)
    assert file is not None
    _, end = LINES[file]
    lines = [f"# Settings for a better log than {file_name(report.file)}, by rotorfit settings."]
    for setting in to_write(report):
        was = "" if setting.old is None else f" It was {setting.old}."
        lines += [
            f"# {_explain_setting(setting)}.{was}",
            _setting_line(report, setting, setting.new or ""),
        ]
    lines += [f"# For you to decide: {line}" for line in decision_lines(report)]
    return "\n".join([*lines, *(end if to_write(report) else ()), ""])


def _explain_setting(setting: Setting) -> str:
    """Explain a setting, with the words that stand beside its value."""
    more = (
        setting.value.removeprefix(setting.new or "")
        .removeprefix(",")
        .strip()
        .removeprefix("which ")
    )
    parts: Sequence[str] = [more, setting.why] if more else [setting.why]
    return "; ".join(parts)


def _setting_line(report: AdvisedSettings, setting: Setting, value: str) -> str:
    if setting.name.endswith(WHOLE_LINE):
        return value
    line, _ = LINES[file_of(report) or ""]
    return line(setting.name, value)
