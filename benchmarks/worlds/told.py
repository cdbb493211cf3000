"""How much larger is an interval than that of an estimator told of the hazard?

Of each hazard of a world there is a reference. Where log or experiment file can say what the
hazard is, the same flight with that said (`SAID`); else the same world flown without it.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from benchmarks.worlds.sensing import truth
from benchmarks.worlds.world import World
from scipy.spatial.transform import Rotation

Row = dict[str, Any]
GIVEN: Final = ("identified", "weak")
MAIN: Final = ("kt", "kd", "Jr", "Ixx_com", "Iyy_com", "Izz_com", "com_x", "com_y")
"""Numbers that have a column of their own."""
ENOUGH: Final = 3
"""Pairs of intervals of which a median says something."""


def _logged(channel: str) -> Callable[[World], World | None]:
    """Return how to log a channel that the log lacks."""

    def told(world: World) -> World | None:
        has = world.log.has
        return None if channel in has else _with_log(world, has=(*has, channel))

    return told


def _declared(**log: Any) -> Callable[[World], World]:
    return lambda world: _with_log(world, **log)


def _right(name: str) -> Callable[[World], World]:
    """Return how to take back a wrong declaration."""
    return lambda w: _with_log(w, mislaid=tuple(one for one in w.log.mislaid if one != name))


def _with_log(world: World, **changes: Any) -> World:
    return replace(world, log=replace(world.log, **changes))


def _axes(world: World) -> World:
    return _with_log(world, axes_declared=True)


def _lags(world: World) -> World | None:
    commanded = world.log.driven == "commanded"
    return _with_log(world, lag_declared=True) if commanded else None


def _tilt(world: World) -> World:
    roll, pitch, _ = Rotation.from_matrix(world.sensors.turn).as_euler("XYZ", degrees=True).tolist()
    return _with_log(world, tilt_declared=(roll, -pitch))


def _delay(world: World) -> World | None:
    seconds = truth(world).get("motor_delay")
    return None if seconds is None else _with_log(world, delay_declared=seconds)


def _voltage(world: World) -> World | None:
    commanded = world.log.driven == "commanded" and world.log.law == "given"
    return _logged("battery")(world) if commanded else None


SAID: Final[Mapping[str, tuple[str, Callable[[World], World | None]]]] = {
    "tilted_motors": ("axes of the motors", _axes),
    "lag_unlike": ("lag up and down", _lags),
    "lag_on_thrust": ("lag, and that it acts on thrust", _lags),
    "command_delay": ("delay", _delay),
    "imu_clock": ("delay", _delay),
    "sag": ("battery", _voltage),
    "no_law": ("law", _declared(law="given")),
    "law_wrong": ("law", _declared(law_error=0.0)),
    "tilted_imu": ("tilt of the IMU", _tilt),
    "drag": ("velocity", _logged("vel")),
    "inflow": ("velocity", _logged("vel")),
    **{name: ("right way", _right(name)) for name in ("wrong_spins", "wrong_order", "wrong_sides")},
    "mass_scale": ("right way", _declared(mass_scale=1.0)),
    "arm_scale": ("right way", _declared(arm_scale=1.0)),
}
"""What log or experiment file say of a hazard, and how; None of a world where they cannot."""


def tell(world: World, hazard: str) -> tuple[str, World] | None:
    """Return what is said of a hazard and the world with that said; None where nothing can be."""
    if hazard not in SAID:
        return None
    words, told = SAID[hazard]
    other = told(world)
    return None if other is None else (words, other)


def ratios(rows: Iterable[Row]) -> Iterator[tuple[str, str, str, float]]:
    """Yield hazard, reference, number and its half-width over that of the reference."""
    for row in rows:
        for hazard, (words, numbers) in row.get("told", {}).items():
            for name, (_, half, verdict) in row.get("numbers", {}).items():
                other = numbers.get(name)
                if other and verdict in GIVEN and other[2] in GIVEN and other[1] > 0.0:
                    yield hazard, words, name, half / other[1]


def told_table(rows: Sequence[Row]) -> list[str]:
    """Return the table of median ratios, a line for each hazard and reference."""
    by: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for hazard, words, name, ratio in ratios(rows):
        by[hazard, words][name].append(ratio)
        by[hazard, words]["all"].append(ratio)
    if not by:
        return []
    lines = [
        "Half-width over that of an estimator told of the hazard: the same flight with what is"
        " said, or flown without; median (pairs of all numbers, ninth tenth)",
        f"{'':18s} {'reference':32s} {'all':>20s}" + "".join(f"{name:>8s}" for name in MAIN),
    ]
    for (hazard, words), found in sorted(by.items()):
        every = found["all"]
        cell = f"{np.median(every):.2f} ({len(every)}, {np.quantile(every, 0.9):.2f})"
        cells = [_median(found[name]) for name in MAIN]
        lines.append(f"{hazard:18s} {words:32s} {cell:>20s}{''.join(cells)}")
    return lines


def _median(found: Sequence[float]) -> str:
    return f"{np.median(found):8.2f}" if len(found) >= ENOUGH else f"{'':8s}"
