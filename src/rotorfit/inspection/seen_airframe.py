"""What a flight and its log say of the airframe, where nobody has described it yet."""

import re
import tomllib
from dataclasses import dataclass
from typing import Final

from rotorfit.inspection.inspect_log import LogReport
from rotorfit.logs.flight_log import FlightLog
from rotorfit.logs.formats import BY_NAME
from rotorfit.model.layouts import LAYOUTS

_BORNE_OUT: Final = re.compile(
    r'layout = "(?P<layout>[^"]+)", order = "(?P<order>[^"]+)"(?P<turned> with every spin rev)?'
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenAirframe:
    """What a log says of the airframe.

    Attributes
    ----------
    rotors
        How many; None where the log has no motors.
    layout, order
        That the flight confirms, else the order that is usual for such a log.
    borne_out
        Whether it is the flight that says so.
    turned
        Whether every rotor turns the other way (props out).
    speed
        ``measured`` or ``commanded``.
    sites
        Forward, left and spin of each rotor by the log's parameters, of any size; none where it has
        no such, or the flight itself shows the layout.
    """

    rotors: int | None = None
    layout: str | None = None
    order: str | None = None
    borne_out: bool = False
    turned: bool = False
    speed: str | None = None
    sites: tuple[tuple[float, float, str], ...] = ()


def seen_airframe(log: FlightLog, report: LogReport) -> SeenAirframe:
    """Read from a log and its report what they say of the airframe."""
    motors = log.channels.get("rotor_speed", log.channels.get("command"))
    if motors is None:
        return SeenAirframe()
    count = motors.values.shape[1]
    speed = "measured" if "rotor_speed" in log.channels else "commanded"
    found = _BORNE_OUT.match((report.prospects and report.prospects.motors) or "")
    if found is None:
        sites = _logged_sites(log)
        return SeenAirframe(
            rotors=count,
            order=_usual_order(log),
            speed=speed,
            sites=sites if len(sites) == count else (),
        )
    return SeenAirframe(
        rotors=count,
        layout=found["layout"],
        order=_logged_order(log, found["layout"], found["order"]),
        borne_out=True,
        turned=found["turned"] is not None,
        speed=speed,
    )


def _logged_sites(log: FlightLog) -> tuple[tuple[float, float, str], ...]:
    """Return the rotors that the parameters of a log list (PX4's CA_ROTOR*)."""
    text = log.metadata.get("airframe", "") if log.format == "ulog" else ""
    rotors = tomllib.loads(text).get("rotors", [])
    return tuple((r["position"][0], r["position"][1], r["spin"]) for r in rotors)


def _usual_order(log: FlightLog) -> str | None:
    form = BY_NAME.get(log.format)
    return None if form is None else form.motor_order


def _logged_order(log: FlightLog, layout: str, order: str) -> str:
    """Name a motor order by the log's autopilot, where the two are the same."""
    usual = _usual_order(log) or order
    return usual if LAYOUTS.get((layout, usual)) == LAYOUTS[layout, order] else order
