"""What the worlds show: does each number hold, is what is said of a world true of it?"""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from benchmarks.worlds.hazards import CAUSES, HAZARDS, NAMED
from benchmarks.worlds.told import told_table

Row = dict[str, Any]
SHOWN: Final = (
    "kt", "kd", "Jr", "Ixx_com", "Iyy_com", "Izz_com", "Ixy_com", "Ixz_com", "Iyz_com",
    "com_x", "com_y", "com_z", "kd_over_kt", "Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt",
    "kd_over_Izz", "Jr_over_Izz", "hover_speed", "motor_lag", "motor_lag_up", "motor_lag_down",
    "motor_delay", "command_delay", "max_speed", "twist",
    "accel_bias_x", "accel_bias_y", "accel_bias_z", "kt_i",
)  # fmt: skip
GIVEN: Final = ("identified", "weak")
GOAL: Final = 0.9
"""Of the identified intervals with any single hazard hold so many."""
ENOUGH: Final = 8
"""Intervals, of which a share says something."""
SIDES_WRONG: Final = 1.25
"""Ratio of a frame's sides over the true one, with the hazard."""
GYRO_WRONG: Final = 0.02
"""Least error of a gyro's scale, with the hazard."""
SPOILT: Final = {kind: {h.name for h in HAZARDS if h.kind == kind} for kind in ("ruin", "wrong")}
SPOILT["invisible"] = {h.name for h in HAZARDS if h.kind == "invisible"}


@dataclass(frozen=True, slots=True)
class Held:
    """One number of one world: does its interval hold, half-width and miss over its scale."""

    row: Row
    name: str
    verdict: str
    miss: float
    half: float

    @property
    def error(self) -> float:
        return abs(self.miss)

    @property
    def holds(self) -> bool:
        return self.error <= self.half

    @property
    def hazards(self) -> set[str]:
        return set(self.row["hazards"])


def kind_of(row: Row) -> str:
    """Say whether a world is sound, its log spoilt, wrongly declared or wrong unseen."""
    if "gyro_scale" in row["hazards"] and not _gyro_is_seen(row):
        return "invisible"
    for kind in ("invisible", "wrong", "ruin"):
        if SPOILT[kind].intersection(row["hazards"]):
            return kind
    return "sound"


def _scale(name: str, known: Mapping[str, float]) -> float:
    """Return what errors of a number are shown in percent of, where its truth may be near zero."""
    sizes = {
        "Ixy_com": ("Ixx_com", "Iyy_com"), "Ixz_com": ("Ixx_com", "Izz_com"),
        "Iyz_com": ("Iyy_com", "Izz_com"),
    }  # fmt: skip
    if name in sizes:
        a, b = sizes[name]
        return float((known[a] * known[b]) ** 0.5)
    if name.startswith(("com_", "twist")):
        return 0.01
    if name.startswith("accel_bias"):
        return 0.2
    if name.endswith("_delay"):
        return 0.005
    if name in ("Jr", "Jr_over_Izz") and known[name] == 0.0:
        return 1e-3 * (known["Izz_com"] if name == "Jr" else 1.0)
    return abs(known[name])


def numbers(rows: Iterable[Row]) -> list[Held]:
    """Return every number that is given with a verdict `identified` or `weak`."""
    return [
        Held(
            row, re.sub(r"^kt_\d$", "kt_i", name), verdict,
            (value - row["truth"][name]) / _scale(name, row["truth"]),
            half / _scale(name, row["truth"]),
        )
        for row in rows
        for name, (value, half, verdict) in row.get("numbers", {}).items()
        if verdict in GIVEN and name in row["truth"]
    ]  # fmt: skip


def report(rows: Sequence[Row], before: Sequence[Row] = ()) -> list[str]:
    """Return all tables, those of an earlier run beside them."""
    runs = [list(rows), list(before)] if before else [list(rows)]
    if before:
        both = {row["index"] for row in rows} & {row["index"] for row in before}
        runs = [[row for row in run if row["index"] in both] for run in runs]
    parts = (
        _overview, _by_parameter, _by_hazard, _by_parameter_and_hazard, _refusals, _findings,
        _wrong, _invisible, lambda each: told_table(each[0]),
    )  # fmt: skip
    return [line for part in parts for line in [*part(runs), ""]] + _worst(runs[0])


def _beside(texts: Iterable[str]) -> str:
    return "  |".join(texts)


def _overview(runs: list[list[Row]]) -> list[str]:
    lines: list[str] = []
    for title, run in zip(("now", "before"), runs, strict=False):
        kinds = Counter(kind_of(row) for row in run)
        lost, died = (sum(bool(row.get(k)) for row in run) for k in ("lost", "died"))
        torn = sum("traceback" in row for row in run)
        seconds = [row["seconds"] for row in run if "seconds" in row]
        many = np.mean([len(row["hazards"]) for row in run]) if run else 0.0
        lines.append(
            f"{title}: {len(run)} worlds, "
            + ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
            + f"; {many:.1f} hazards each; {lost} out of control, {died} too slow or died, "
            f"{torn} tracebacks; {np.median(seconds or [0]):.1f} s to identify (median)"
        )
    return lines


def _rate(found: Sequence[Held]) -> str:
    if not found:
        return f"{'':11s}"
    return f"{np.mean([one.holds for one in found]):5.2f} ({len(found):4d})"


def _by_parameter(runs: list[list[Row]]) -> list[str]:
    head = f"{'identified':>12s} {'weak':>12s} {'half %':>7s} {'error %':>8s} {'ratio':>6s}"
    lines = [
        "Sound worlds: share of the intervals that hold (of how many), median half-width and error",
        f"{'':14s}" + _beside([head] * len(runs)),
    ]
    found = [numbers(_of(run, "sound")) for run in runs]
    for name in (*SHOWN, "all"):
        chosen = [[one for one in each if name in (one.name, "all")] for each in found]
        if any(chosen):
            lines.append(f"{name:14s}" + _beside(_columns(each) for each in chosen))
    return lines


def _columns(found: Sequence[Held]) -> str:
    by = [[one for one in found if one.verdict == verdict] for verdict in GIVEN]
    if not found:
        return " " * 49
    half, error = (
        100 * float(np.median([getattr(o, k) for o in found])) for k in ("half", "error")
    )
    ratio = half / error if error > 0 else np.inf
    return f" {_rate(by[0]):>11s} {_rate(by[1]):>12s} {half:7.2f} {error:8.2f} {ratio:6.1f}"


def _of(run: Iterable[Row], kind: str) -> list[Row]:
    return [row for row in run if kind_of(row) == kind and not row.get("lost")]


def _groups(run: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the worlds of each hazard, flight, layout and log; without the invisible and wrong."""
    out: dict[str, list[Row]] = {"(all)": [], "(sound)": [], "(sound, hazard-free)": []}
    for row in run:
        if row.get("lost") or row.get("died") or kind_of(row) in ("invisible", "wrong"):
            continue
        out["(all)"].append(row)
        if kind_of(row) == "sound":
            out["(sound)"].append(row)
        if not row["hazards"]:
            out["(sound, hazard-free)"].append(row)
        keys = [*row["hazards"], *(f"{row[k]}" for k in ("manoeuvre", "layout", "driven"))]
        for key in [*keys, f"{row['rate']} Hz"]:
            out.setdefault(key, []).append(row)
    return out


def _by_hazard(runs: list[list[Row]]) -> list[str]:
    head = f"{'worlds':>6s} {'refused':>7s} {'identified':>12s} {'weak':>12s} {'half/err':>8s}"
    lines = [
        "Worlds with each hazard (and others): how many, refused, share of all intervals that hold"
        f" (< {GOAL:.2f}: identified ones, fewer than that hold)",
        f"{'':22s}" + _beside([head] * len(runs)),
    ]
    groups = [_groups(run) for run in runs]
    order = ["(all)", "(sound)", "(sound, hazard-free)", *NAMED]
    order += sorted(set(groups[0]) - set(order))
    for name in order:
        if any(name in each for each in groups):
            cells = [_hazard_columns(each.get(name, [])) for each in groups]
            lines.append(f"{name:22s}" + _beside(cells))
    return lines


def _hazard_columns(rows: Sequence[Row]) -> str:
    found = numbers(rows)
    by = [[one for one in found if one.verdict == verdict] for verdict in GIVEN]
    refused = sum("refused" in row for row in rows)
    ratio = np.median([o.half for o in found]) / np.median([o.error for o in found]) if found else 0
    mark = "<" if len(by[0]) >= ENOUGH and np.mean([o.holds for o in by[0]]) < GOAL else " "
    return f"{len(rows):6d} {refused:7d} {_rate(by[0]):>12s}{mark}{_rate(by[1]):>12s} {ratio:8.1f}"


def _by_parameter_and_hazard(runs: list[list[Row]]) -> list[str]:
    """List where a number holds less often than it should under one hazard, worst first."""
    lines = [
        "Number and hazard where fewer than .90 of the identified intervals hold, of 8 or more"
    ]
    cells: list[tuple[float, str]] = []
    for hazard, rows in _groups(runs[0]).items():
        by_name: dict[str, list[Held]] = defaultdict(list)
        for one in numbers(rows):
            if one.verdict == "identified":
                by_name[one.name].append(one)
        for name, found in by_name.items():
            share = float(np.mean([one.holds for one in found]))
            if len(found) >= ENOUGH and share < GOAL:
                bad = [one for one in found if not one.holds]
                over = np.median([one.error / one.half for one in bad])
                cells.append(
                    (share, f"  {name:14s} {hazard:20s} {share:5.2f} ({len(found):3d}), outside "
                     f"by {over:.1f} half-widths (median)")
                )  # fmt: skip
    return [*lines, *(text for _, text in sorted(cells)[:40])]


def _refusals(runs: list[list[Row]]) -> list[str]:
    lines = ["Sound worlds refused"]
    for title, run in zip(("now", "before"), runs, strict=False):
        sound = _of(run, "sound")
        refused = [row for row in sound if "refused" in row]
        share = 100.0 * len(refused) / max(len(sound), 1)
        lines.append(f"  {title}: {len(refused)} of {len(sound)}, {share:.1f} %")
        for row in refused:
            lines.append(f"    {_name(row)} [{row['refused']}] {row['sentence'][:230]}")
    return lines


def _findings(runs: list[list[Row]]) -> list[str]:
    lines = [
        "Doubts and refusals by kind: said in how many worlds with a cause of it, without one",
        f"{'':36s}" + _beside([f"{'with':>14s} {'without':>14s}"] * len(runs)),
    ]
    said = [_said(run) for run in runs]
    for key in sorted({key for each in said for key in each}):
        cells = [
            _finding_columns(key, each.get(key, set()), run)
            for each, run in zip(said, runs, strict=True)
        ]
        lines.append(f"{key[1] + ' (' + key[0] + ')':36s}" + _beside(cells))
    return lines


def _said(run: Sequence[Row]) -> dict[tuple[str, str], set[int]]:
    out: dict[tuple[str, str], set[int]] = {}
    for row in run:
        for kind, severity, _ in row.get("findings", ()):
            if severity == "doubt":
                out.setdefault(("doubt", kind), set()).add(row["index"])
        if "refused" in row:
            out.setdefault(("refusal", row["refused"]), set()).add(row["index"])
    return out


def _finding_columns(key: tuple[str, str], said: set[int], run: Sequence[Row]) -> str:
    usable = [row for row in run if not row.get("lost") and not row.get("died")]
    causes = CAUSES.get(key[1])
    if causes is None:
        return f"{'':14s} {len(said):4d} of {len(usable):5d} (no cause)"
    with_cause = {row["index"] for row in usable if causes.intersection(row["hazards"])}
    without = {row["index"] for row in usable} - with_cause
    return _part(said & with_cause, with_cause) + " " + _part(said & without, without)


def _part(some: set[int], of: set[int]) -> str:
    return f"{len(some):4d}/{len(of):<4d} {100.0 * len(some) / max(len(of), 1):3.0f}%"


def _wrong(runs: list[list[Row]]) -> list[str]:
    """Say of wrong declarations how many are refused or doubted, and what is wrong silently."""
    lines = [
        "Wrong declarations: worlds, refused, doubted for it; identified numbers that hold; "
        "and of those that no log can show, apart"
    ]
    for title, run in zip(("now", "before"), runs, strict=False):
        for hazard in sorted(SPOILT["wrong"]):
            rows = [r for r in _of(run, "wrong") if hazard in r["hazards"]]
            cells = [
                _wrong_columns([row for row in rows if is_seen(row) is seen], hazard)
                for seen in (True, False)
            ]
            lines.append(f"  {title} {hazard:16s} {_beside(cells)}")
    return lines


def _wrong_columns(rows: Sequence[Row], hazard: str) -> str:
    refused = sum("refused" in row for row in rows)
    doubted = sum(is_doubted(row, hazard) for row in rows)
    found = [one for one in numbers(rows) if one.verdict == "identified"]
    return f"{len(rows):4d} {refused:4d} {doubted:4d} {_rate(found)}"


def is_seen(row: Row) -> bool:
    """Return whether a log can show its wrong declaration.

    Of wrong sides: whether the flight's own interval of their ratio is narrower than the mistake.
    Of a wrong law: whether only commands tell the speeds.
    """
    if "law_wrong" in row["hazards"] and row["driven"] == "measured":
        return False
    if "wrong_sides" not in row["hazards"] or "refused" in row:
        return True
    low, high = row.get("sides") or (0.0, np.inf)
    return low > 0.0 and high / low < SIDES_WRONG**2


def _gyro_is_seen(row: Row) -> bool:
    """Return whether a log can show a scale of the gyro.

    It takes a velocity, and turns: whether by these its interval is narrower than the least error.
    """
    if "numbers" not in row:
        return "vel" in row["has"]
    reach = [0.5 * (high - low) for low, high in row.get("gyro", ())]
    return bool(reach) and max(reach) < GYRO_WRONG


def is_doubted(row: Row, hazard: str) -> bool:
    """Return whether a doubt may rightly come from a hazard."""
    return any(
        severity == "doubt" and hazard in CAUSES.get(kind, set())
        for kind, severity, _ in row.get("findings", ())
    )


def _invisible(runs: list[list[Row]]) -> list[str]:
    rows = _of(runs[0], "invisible")
    found = [one for one in numbers(rows) if one.verdict == "identified"]
    return [f"Invisible hazards (apart): {len(rows)} worlds, identified {_rate(found)}"]


def _worst(run: Sequence[Row]) -> list[str]:
    """List ten worlds: first those with the numbers farthest outside."""
    usable = [row for row in run if kind_of(row) in ("sound", "ruin")]
    by_world: dict[int, list[Held]] = defaultdict(list)
    for one in numbers(usable):
        if one.verdict == "identified" and not one.holds:
            by_world[one.row["index"]].append(one)
    worst = sorted(by_world.values(), key=lambda found: -max(map(_excess, found)))[:10]
    lines = [
        "Worst worlds (sound or spoilt logs): identified numbers outside, error over half-width"
    ]
    for found in worst:
        row = found[0].row
        outside = sorted(found, key=_excess, reverse=True)
        shown = ", ".join(f"{o.name} {_signed(o)}" for o in outside[:6])
        lines += [
            f"  {_name(row)}: {shown}",
            f"    {' '.join(row['hazards'])}",
            f"    {repeats(row)}",
        ]
        lines += [
            f"    - {text[:200]}" for _, severity, text in row["findings"] if severity == "doubt"
        ]
    return lines


def _signed(one: Held) -> str:
    return f"{100.0 * one.miss:+.1f}+-{100.0 * one.half:.1f}%"


def _excess(one: Held) -> float:
    return one.error / max(one.half, 1e-12)


def _name(row: Row) -> str:
    about = (
        f"{row['layout']}, {row['mass']} kg, {row['manoeuvre']}, {row['driven']}, {row['rate']} Hz"
    )
    return f"world {row['index']} ({about})"


def repeats(row: Row) -> str:
    """Return the command that repeats a world."""
    return f"python -m benchmarks.worlds --seed {row['seed']} --only {row['index']}" + row.get(
        "options", ""
    )


Part = Callable[[list[list[Row]]], list[str]]
