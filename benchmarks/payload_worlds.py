"""Do intervals hold where a vehicle flies bare and with a payload, as the paper's procedure does?

    python -m benchmarks.payload_worlds --seed 71 --worlds 48 -o payload.jsonl  # goes on
    python -m benchmarks.payload_worlds --show payload.jsonl

Each world (`benchmarks.worlds`, sound hazards alone) flies twice: bare as drawn, and with one or
two point masses of 6 to 25 % of its mass, under it, on one arm or at both ends of one, by another
manoeuvre. A scale and a ruler give the masses to .2 % and the places to 1 % of an arm. Three
estimates: the bare flight alone, both with the payload declared, and both with a second body that
is weighed and else free. Prints, number by number, how often their intervals hold, and the half-
widths of the two over that of the bare flight alone.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.joint_worlds import SECONDS, SOUND, given, studied
from benchmarks.worlds.engine import fly
from benchmarks.worlds.sensing import experiment_text, truth, write_world
from benchmarks.worlds.study import identified
from benchmarks.worlds.world import MANOEUVRES, Vehicle, World, draw_world
from jaxtyping import Float

Row = dict[str, Any]
SHARE: Final = (0.06, 0.25)
"""Of the vehicle's mass."""
WEIGHED, MEASURED = 0.002, 0.01
"""Deviation of the masses, as a share, and of their places, over an arm."""
SOUND_LIFT: Final = {name: p for name, p in SOUND.items() if name != "weak_motors"}
"""Motors that carry hardly more than the vehicle cannot carry a payload."""
ESTIMATES: Final = ("bare", "declared", "weighed")


def payload(world: World) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Draw the masses [kg] and places [m] that are added."""
    rng = np.random.default_rng([world.seed, world.index, 77])
    whole = world.vehicle.mass * rng.uniform(*SHARE)
    arm = world.vehicle.arm
    below = np.array([0.0, 0.0, -rng.uniform(0.1, 0.5) * arm])
    turn = rng.uniform(0.0, np.pi)
    along = rng.uniform(0.5, 1.3) * arm * np.array([np.cos(turn), np.sin(turn), 0.0])
    where = str(rng.choice(["under", "one arm", "both ends"]))
    if where == "both ends":
        return np.full(2, 0.5 * whole), np.array([below + along, below - along])
    place = below if where == "under" else 0.3 * along + below
    return np.array([whole]), place[None]


def loaded(
    vehicle: Vehicle, masses: Float[np.ndarray, " p"], places: Float[np.ndarray, "p 3"]
) -> Vehicle:
    """Return the vehicle with point masses."""
    mass = vehicle.mass + masses.sum()
    com = (vehicle.mass * vehicle.com + masses @ places) / mass
    inertia = vehicle.inertia.copy()
    parts = zip([vehicle.mass, *masses], [vehicle.com, *places], strict=True)
    for own, place in parts:
        r = place - com
        inertia = inertia + own * (r @ r * np.eye(3) - np.outer(r, r))
    return replace(vehicle, mass=float(mass), com=com, inertia=inertia)


def flights(seed: int, index: int) -> tuple[World, World]:
    """Draw the bare flight of a world and the loaded one."""
    world = draw_world(seed, index, SOUND_LIFT, SECONDS)
    world = replace(world, log=replace(world.log, imu_declared=True))
    rng = np.random.default_rng([seed, index, 78])
    manoeuvre = str(rng.choice([name for name in MANOEUVRES if name != "throw"]))
    flight = replace(world.flight, manoeuvre=manoeuvre, axis=int(rng.integers(4)))
    vehicle = loaded(world.vehicle, *payload(world))
    return world, replace(world, index=index + 100_000, vehicle=vehicle, flight=flight)


def second_body(bare: World, other: World, file: str, *, declared: bool) -> str:
    """Return the configuration of the loaded flight, with the payload as a user measures it."""
    rng = np.random.default_rng([bare.seed, bare.index, 79])
    masses, places = payload(bare)
    std = MEASURED * bare.vehicle.arm
    stds = WEIGHED * masses
    read = masses + stds * rng.standard_normal(masses.shape)
    found = places + std * rng.standard_normal(places.shape)
    lines = ["[[configuration]]", 'name = "B"', f"mass = {other.vehicle.mass!r}"]
    lines.append(f'flights = ["{file}"]')
    if not declared:
        return "\n".join([*lines, ""])
    points = (
        f"{{ mass = {float(m)!r}, position = {p.tolist()}, mass_std = {float(s)!r}, "
        f"position_std = {std!r} }}"
        for m, p, s in zip(read, found, stds, strict=True)
    )
    return "\n".join([*lines, 'payload_of = "A"', f"payload = [{', '.join(points)}]", ""])


def rows(seed: int, indices: Sequence[int]) -> Iterator[Row]:
    """Fly some worlds bare and loaded, and identify them in three ways."""
    pairs = [flights(seed, index) for index in indices]
    records = iter(fly([world for pair in pairs for world in pair]))
    for bare, other in pairs:
        flown = [next(records), next(records)]
        if any(record.lost for record in flown):
            continue
        known = truth(bare)
        with tempfile.TemporaryDirectory() as folder:
            alone, second = (
                write_world(*one, Path(folder)) for one in zip((bare, other), flown, strict=True)
            )
            text = experiment_text(bare, alone.with_suffix(".csv").name)
            found = {"bare": identified(alone, known)}
            for name in ESTIMATES[1:]:
                body = second_body(
                    bare, other, second.with_suffix(".csv").name, declared=name == "declared"
                )
                path = Path(folder) / f"{name}.toml"
                path.write_text(text + body, encoding="utf-8")
                found[name] = identified(path, known)
            yield {
                "index": bare.index,
                "hazards": sorted(bare.hazards),
                "manoeuvres": [world.flight.manoeuvre for world in (bare, other)],
                "driven": bare.log.driven,
                "share": float(payload(bare)[0].sum() / bare.vehicle.mass),
                "truth": known,
                **found,
            }


def compared(row: Mapping[str, Any], estimate: str) -> Iterator[tuple[str, float, float]]:
    """Yield of each number its error over the half-width, and that over the bare flight's."""
    alone = given(row["bare"])
    for name, (value, half) in given(row[estimate]).items():
        ratio = half / alone[name][1] if name in alone else np.nan
        yield name, (value - row["truth"][name]) / half, ratio


def report(study: Sequence[Row]) -> list[str]:
    """Return the tables of a study."""
    lines = [f"{len(study)} worlds, bare and loaded"]
    for estimate in ESTIMATES:
        kept = [row for row in study if "numbers" in row[estimate]]
        lines += [f"{estimate}: {len(study) - len(kept)} refused"]
        lines += [
            f"  world {row['index']}: {row[estimate].get('sentence', row[estimate])}"
            for row in study
            if "numbers" not in row[estimate]
        ]
        found = [(row, *one) for row in kept for one in compared(row, estimate)]
        lines += ["number          holds (of)   half-width over that of the bare flight"]
        for name in sorted({one[1] for one in found}):
            off = np.array([one[2] for one in found if one[1] == name])
            ratio = np.array([one[3] for one in found if one[1] == name])
            shown = f"{np.nanmedian(ratio):6.2f}" if np.isfinite(ratio).any() else ""
            lines += [f"{name:15} {np.mean(np.abs(off) <= 1.0):.2f} ({len(off):3})  {shown}"]
        every = np.array([one[2] for one in found])
        lines += [f"{'all':15} {np.mean(np.abs(every) <= 1.0):.3f} ({len(every)})"]
        worst = sorted(found, key=lambda one: -abs(one[2]))[:12]
        lines += [f"  world {one[0]['index']}: {one[1]} {one[2]:+.1f} half-widths" for one in worst]
    return lines


def main() -> None:
    """Fly a study, or show one."""
    print("\n".join(report(studied(__doc__, "payload.jsonl", rows))))


if __name__ == "__main__":
    main()
