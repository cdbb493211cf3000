"""Where to hang a payload: predicted 95 % half-intervals of the bare vehicle, in percent.

The paper's vehicle A (1.285 kg, rotors at 0.20 m, here with the inertia of Table II and without
products) flies 40 s bare and 40 s loaded, rotor speed measured; the same total mass of payload
hangs in different places, weighed to 0.5 g and measured to 2 mm. The predictions are those of
`rotorfit plan`.

    python benchmarks/payload_places.py
"""

from typing import Final

from rotorfit.fit.experiment.payload import PointMass
from rotorfit.model.vehicle import Vehicle, layout_rotors
from rotorfit.simulation.pilot import Manoeuvre
from rotorfit.tools.planning.bound import (
    BARE,
    LOADED,
    Problem,
    combined,
    evidence,
    fly,
    planned_problem,
    predicted,
)
from rotorfit.tools.planning.vehicle import assumptions_for, rough_vehicle

MASS, SECONDS, TOTAL = 1.285, 40.0, 0.16
KNOWN: Final = {"Ixx": 0.0182, "Iyy": 0.0186, "Izz": 0.0288}
NUMBERS: Final = ("kd", "Izz_com@A", "Ixx_com@A", "Iyy_com@A")
SCHEDULES: Final[tuple[Manoeuvre, ...]] = ("turns", "sticks", "wiggles")
Places = tuple[tuple[float, float, float], ...]
PLACES: Final[dict[str, Places]] = {
    "pair at the ends of one arm, 0.37 m": ((0.37, 0.0, 0.0), (-0.37, 0.0, 0.0)),
    "pair on one arm, 0.20 m": ((0.20, 0.0, 0.0), (-0.20, 0.0, 0.0)),
    "one mass on one arm, 0.37 m": ((0.37, 0.0, 0.0),),
    "four, at all arms, 0.20 m": (
        (0.20, 0.0, 0.0),
        (-0.20, 0.0, 0.0),
        (0.0, 0.20, 0.0),
        (0.0, -0.20, 0.0),
    ),
    "under the centre, 0.15 m": ((0.0, 0.0, -0.15),),
}


def problem_of(places: Places) -> Problem:
    vehicle = Vehicle(rotors=layout_rotors("quad-plus", arm=0.20, order="paper"))
    payload = tuple(
        PointMass(mass=TOTAL / len(places), position=at, mass_std=0.0005, position_std=0.002)
        for at in places
    )
    return planned_problem(
        rough_vehicle(vehicle, mass=MASS, known=KNOWN),
        payload,
        assumed=assumptions_for(MASS, log_rate=200.0),
        commanded=False,
        timed=True,
    )


def half_intervals(places: Places, manoeuvre: Manoeuvre, *, loaded: bool) -> list[float]:
    """Return half of each number's interval in percent: 40 s bare, or 40 s bare and 40 s loaded."""
    problem = problem_of(places)
    flown = [(BARE, SECONDS), (LOADED, SECONDS)] if loaded else [(BARE, SECONDS)]
    parts = [
        (evidence(problem, fly(problem, [manoeuvre], name)[manoeuvre], name), seconds)
        for name, seconds in flown
    ]
    numbers = predicted(problem, combined(parts))
    places_of = [numbers.index(name) for name in NUMBERS]
    return [float(100.0 * numbers.half_width[i] / abs(numbers.values[i])) for i in places_of]


def main() -> None:
    for manoeuvre in SCHEDULES:
        print(f"\n{manoeuvre}: half of the 95 % interval [%]")
        print(f"  {'':<38}" + "".join(f"{name.partition('_')[0]:>8}" for name in NUMBERS))
        first = next(iter(PLACES.values()))
        rows = {"bare only": half_intervals(first, manoeuvre, loaded=False)}
        rows |= {
            words: half_intervals(places, manoeuvre, loaded=True)
            for words, places in PLACES.items()
        }
        for words, widths in rows.items():
            print(f"  {words:<38}" + "".join(f"{width:>8.2f}" for width in widths))


if __name__ == "__main__":
    main()
