"""Every parameter that is written, or named in a how-to, is one that the program publishes."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from export_material import a_result, text_of

from rotorfit.tools.inspection.recording import settings_file

HERE = Path(__file__).parent
DOCS = HERE.parents[1] / "docs"
PUBLISHED = tomllib.loads((HERE / "published_parameters.toml").read_text(encoding="utf-8"))
PX4_LINE = re.compile(r"(?:# )?1\t1\t(\w+)\t(\S+)\t([69])$", re.M)
COPTER_LINE = re.compile(r"^([A-Z]\w+),(\S+)$", re.M)
LINES = {"px4": PX4_LINE, "ardupilot": COPTER_LINE}
NAMES = {
    "px4": re.compile(r"\b(?:CA|THR|MPC|SIM|SIH|SDLOG|DSHOT|MOT|UAVCAN|IMU)_[A-Z0-9_]*\w\*?"),
    "ardupilot": re.compile(r"\b(?:FRAME|MOT|LOG|INS|BATT|SERVO|SID)_[A-Z0-9_]*\w"),
}
AS_FILES = {
    "px4": ("px4", "px4-gazebo", "px4-sih"),
    "ardupilot": ("ardupilot",),
}
HEXA = tuple(
    ((0.3 * np.cos(np.radians(a)), -0.3 * np.sin(np.radians(a)), 0.0), s)
    for a, s in zip((30, 90, 150, 210, 270, 330), ("ccw", "cw") * 3, strict=True)
)
LAWS = (
    {"linear": [60.0, 900.0]},
    {"sqrt": {"full_speed": 950.0, "thr_mdl_fac": 0.3}},
    {"sqrt": {"full_speed": 990.0, "thr_mdl_fac": 0.65, "start": 0.15, "end": 0.95}},
)


@dataclass(frozen=True)
class Published:
    is_integer: bool
    low: float
    high: float
    default: float | None


def published(program):
    """Return the published parameters by name, instances written out."""
    found = {}
    for name, row in PUBLISHED[program]["parameters"].items():
        low, high = row.get("range", (-np.inf, np.inf))
        one = Published(row.get("type") == "int", low, high, row.get("default"))
        numbers = range(row["first"], row["last"] + 1) if "first" in row else [""]
        found |= {name.replace("n", str(number)): one for number in numbers}
    return found


def vehicles():
    yield from (a_result(law=law) for law in LAWS)
    yield from (a_result(rotors=HEXA, law=law, com=np.zeros(3)) for law in LAWS)


@pytest.mark.parametrize("program", AS_FILES)
def test_what_is_exported_is_published_and_in_range(program):
    known, seen = published(program), set()
    for result in vehicles():
        for target in AS_FILES[program]:
            for name, value, *kind in LINES[program].findall(text_of(result, target)):
                limits = known[name]
                assert limits.low <= float(value) <= limits.high, (target, name)
                assert not kind or (kind == ["6"]) == limits.is_integer, name
                assert not limits.is_integer or float(value).is_integer(), name
                seen.add(name)
    assert len(seen) > (60 if program == "px4" else 5)


@pytest.mark.parametrize(("program", "log_format"), [("px4", "ulog"), ("ardupilot", "dataflash")])
def test_the_files_of_settings_are_published_and_in_range(program, log_format):
    known = published(program)
    lines = LINES[program].findall(settings_file(log_format).read_text(encoding="utf-8"))
    assert len(lines) > 5
    for name, value, *kind in lines:
        assert known[name].low <= float(value) <= known[name].high, name
        assert not kind or (kind == ["6"]) == known[name].is_integer, name


@pytest.mark.parametrize("program", NAMES)
def test_every_line_of_the_how_to_names_what_there_is(program):
    known = published(program)
    page = (DOCS / "howto" / f"{program}.md").read_text(encoding="utf-8")
    names = {name for name in NAMES[program].findall(page) if "PARAM" not in name}
    assert len(names) > 8
    for name in names:
        start = name.rstrip("*").removesuffix("_")
        assert name in known or any(one.startswith(start) for one in known), name
    for name, value in re.findall(r"`([A-Z_0-9]+)` (?:= )?(-?[\d.]+)\b", page):
        if name in known:
            assert known[name].low <= float(value) <= known[name].high, (name, value)


def test_the_advised_bits_are_the_default_s_and_ours():
    """LOG_BITMASK and SDLOG_PROFILE keep every bit of the default."""
    copter, px4 = published("ardupilot"), published("px4")
    mask = dict(COPTER_LINE.findall(settings_file("dataflash").read_text(encoding="utf-8")))
    assert int(mask["LOG_BITMASK"]) == int(copter["LOG_BITMASK"].default) | 1 | 1 << 18
    lines = PX4_LINE.findall(settings_file("ulog").read_text(encoding="utf-8"))
    profile = {name: value for name, value, _ in lines}["SDLOG_PROFILE"]
    assert int(profile) == int(px4["SDLOG_PROFILE"].default) | 1 << 4
