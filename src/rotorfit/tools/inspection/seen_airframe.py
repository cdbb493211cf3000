"""Estimate the airframe from a flight and its log, where nobody has described it yet."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rotorfit.errors import FlightError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.formats import BY_NAME
from rotorfit.tools.inspection.flown_part import (
    NAMED_LAYOUT,
    SPINS_UNSURE,
    expected_response,
    is_posed,
    name_in_usual_order,
    prepare_if_usable,
    tried_response,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.model.vehicle import Vehicle


@frozen_dataclass
class SeenAirframe:
    """The airframe as far as a log shows it.

    - `rotors`: how many; None if the log has no motors.
    - `layout`, `order`: that the flight confirms, else the order that is usual for such a log.
    - `borne_out`: whether it is the flight that says so.
    - `spins_shown`: whether the flight yaws enough to show the spins, too.
    - `turned`: whether every rotor turns the other way (props out); False if that is not shown.
    - `speed`: ``measured`` or ``commanded``.
    - `sites`: forward, left and spin of each rotor, of any size: by the log's parameters, or, of a
      quadrotor with a motor order of its own, by the flight; empty if neither says so, or the
      flight shows a known layout.
    - `sites_flown`: whether it is the flight that says so of `sites`.
    - `rotors_table`: the rotors with their places [m] by the log's parameters, as ``[airframe]``
      has them, where somebody has set them; empty otherwise.
    - `posed`: whether only poses show the motion.
    """

    rotors: int | None = None
    layout: str | None = None
    order: str | None = None
    borne_out: bool = False
    spins_shown: bool = False
    turned: bool = False
    speed: str | None = None
    sites: tuple[tuple[float, float, str], ...] = ()
    sites_flown: bool = False
    rotors_table: tuple[Mapping[str, Any], ...] = ()
    posed: bool = False


def motors_in_flight(log: FlightLog) -> tuple[str | None, Vehicle | None]:
    """Name the layout and motor order that a flight confirms, as `inspect_log` does.

    With the rotors of a quadrotor whose motors have an order of their own, by the flight.
    """
    from rotorfit.fit.reduction.frequency_bands import retimed
    from rotorfit.tools.inspection.guessed_rotors import (
        factors_on_circle,
        likely_motors,
        own_order,
    )
    from rotorfit.tools.inspection.lag_search import lines_of_body
    from rotorfit.tools.inspection.motor_lateness import motor_lateness

    # Only the parts of the inspection that this takes are done.
    prepared, _ = prepare_if_usable(log)
    if prepared is None:
        return None, None
    response = tried_response(
        expected_response(log, motor_lateness(prepared.data)),
        commanded="rotor_speed" not in log.channels,
    )
    try:
        body = lines_of_body(prepared)
        timed = replace(prepared, data=retimed(prepared, response))
        factors, circle = factors_on_circle(timed, body=body)
    except FlightError:
        return None, None
    confirmed = likely_motors(factors, circle)
    own = own_order(factors, circle, confirmed and confirmed[0])
    if own is not None or confirmed is None:
        return None, own
    return name_in_usual_order(log, confirmed[1]), None


def seen_airframe(
    log: FlightLog, confirmed: str | None, own: Vehicle | None = None
) -> SeenAirframe:
    """Read from a log what it says of the airframe.

    `confirmed`, `own`: layout and motor order that its flight confirms, and rotors in an order of
    their own, from `motors_in_flight`; the first from the prospects of a report, too.
    """
    motors = log.channels.get("rotor_speed", log.channels.get("command"))
    if motors is None:
        return SeenAirframe()
    count = motors.values.shape[1]
    speed = "measured" if "rotor_speed" in log.channels else "commanded"
    found = NAMED_LAYOUT.match(confirmed or "")
    listed = _logged_rotors(log, count)
    table = listed if log.metadata.get("airframe is") == "set" else ()
    if found is None:
        sites = tuple((r["position"][0], r["position"][1], r["spin"]) for r in listed)
        flown = () if own is None else tuple((*r.position[:2], r.spin) for r in own.rotors)
        return SeenAirframe(
            rotors=count,
            order=_usual_order(log),
            speed=speed,
            sites=sites or flown,
            sites_flown=not sites and bool(flown),
            rotors_table=table,
            posed=is_posed(log),
        )
    spins_shown = SPINS_UNSURE not in (confirmed or "")
    return SeenAirframe(
        rotors=count,
        layout=found["layout"],
        order=found["order"],
        borne_out=True,
        spins_shown=spins_shown,
        turned=spins_shown and found["turned"] is not None,
        speed=speed,
        rotors_table=table,
    )


def logged_tables(log: FlightLog) -> dict[str, Any] | None:
    """Return ``[airframe]`` and ``[motors]`` by a log's parameters; None if nobody set them."""
    motors = log.channels.get("rotor_speed", log.channels.get("command"))
    if motors is None or log.metadata.get("airframe is") != "set":
        return None
    rotors = [dict(rotor) for rotor in _logged_rotors(log, motors.values.shape[1])]
    speed = "measured" if "rotor_speed" in log.channels else "commanded"
    return {"airframe": {"rotors": rotors}, "motors": {"speed": speed}} if rotors else None


def _logged_rotors(log: FlightLog, count: int) -> tuple[Mapping[str, Any], ...]:
    """Return the rotors that the parameters of a log list (PX4's CA_ROTOR*), if one a motor."""
    text = log.metadata.get("airframe", "") if log.format == "ulog" else ""
    rotors = tuple(tomllib.loads(text).get("rotors", ()))
    return rotors if len(rotors) == count else ()


def _usual_order(log: FlightLog) -> str | None:
    form = BY_NAME.get(log.format)
    return None if form is None else form.motor_order
