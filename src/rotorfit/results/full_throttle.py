"""Full thrust at the battery's voltage: as the motors' law has it, and under full load.

The law from command to speed holds at one voltage, that of its flights or the firmware's nominal
one. At full throttle the battery gives less, and the rotors turn slower with it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.root import root_between
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.intervals.interval_terms import (
    NumberTerm,
    half_width_of_number,
    scale_terms,
)
from rotorfit.flight.motors.battery_sag import (
    LOAD_EXPONENT,
    LOAD_EXPONENT_STD,
    BatterySag,
    relative_load,
)
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.command_law import AT_COMMAND, UNDER_LOAD
from rotorfit.results.command_units import flight_number
from rotorfit.results.law_tables import voltage_exponent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.estimation.measured import Measured
    from rotorfit.fit.dataset.dataset import ConfigurationData, Dataset, LoadedFlight
    from rotorfit.results.result import Derived
    from rotorfit.results.tables import ResultTables

VOLTAGE: Final = "full-throttle-voltage"
SAG_SOURCE: Final = "the fall of the voltage under load, and how motors differ in current"
EMPTY: Final = 0.2
"""Share of its voltage at rest below which no battery is looked for."""


@frozen_dataclass
class FullLoad:
    """A vehicle at full throttle on a battery that sags.

    - `speed`: full rotor speed at `nominal` volts over that in hover.
    - `sag`: in hover, under a load that is held.
    - `nominal`: voltage of the law [V].
    - `exponent`: of the voltage, in the speed at full command.
    - `load_exponent`: see `relative_load`.
    """

    speed: float
    sag: BatterySag
    nominal: float
    exponent: float
    load_exponent: float = LOAD_EXPONENT

    def speed_at(self, voltage: float) -> float:
        """Return full speed at a voltage over the speed in hover."""
        return self.speed * (voltage / self.nominal) ** self.exponent

    @property
    def voltage(self) -> float:
        """The voltage at which battery and motors agree [V]."""

        def beyond(voltage: float) -> float:
            cubed = np.asarray(self.speed_at(voltage) ** 3)
            load = relative_load(cubed, np.asarray(voltage / self.sag.voltage), self.load_exponent)
            return self.sag.at_load(float(load)) - voltage

        rest = self.sag.at_load(0.0)
        lowest = EMPTY * rest
        return root_between(beyond, lowest, rest) if beyond(lowest) > 0.0 else lowest

    @property
    def thrust(self) -> float:
        """Thrust at full throttle over the weight."""
        return self.speed_at(self.voltage) ** 2


def with_full_throttle(tables: ResultTables, dataset: Dataset) -> ResultTables:
    """Add the voltage of full thrust, and thrust under full load where the flight shows the sag."""
    known = [d for d in tables.derived if d.name == "thrust_to_weight" and d.value is not None]
    nominal = voltage_of_law(tables, dataset)
    if not known or nominal is None:
        return tables
    loaded = [
        (ratio, load)
        for ratio in known
        for configured in dataset.configurations
        if configured.entry.name == ratio.configuration
        for load in [_full_load(tables, configured, ratio, nominal)]
        if load is not None
    ]
    diagnostics = {**tables.diagnostics, AT_COMMAND: nominal}
    bodies: list[Derived] = []
    for ratio, load in loaded:
        bodies.append(_thrust_to_weight(tables, ratio, load))
    if loaded:
        diagnostics[UNDER_LOAD] = loaded[0][1].voltage
        bodies.insert(0, _max_thrust(tables, *loaded[0]))
    tables = replace(tables, derived=(*tables.derived, *bodies), diagnostics=diagnostics)
    return tables.found(_voltage_finding(nominal, diagnostics.get(UNDER_LOAD)))


def voltage_of_law(tables: ResultTables, dataset: Dataset) -> float | None:
    """Return the voltage at which full thrust holds [V]; None if the logs do not say it."""
    found, given = tables.command_law, dataset.motors.law
    if found is not None and found.known and found.nominal_voltage is not None:
        return found.nominal_voltage
    if found is None and given is not None and given.voltage is not None:
        return given.voltage.nominal
    return mean_voltage(dataset.flights)


def mean_voltage(flights: Sequence[LoadedFlight]) -> float | None:
    """Average the voltage in flight [V]; None if a log has none."""
    volts = [f.battery for f in flights if f.battery is not None and f.battery > 0.0]
    return float(np.mean(volts)) if volts and len(volts) == len(flights) else None


def _full_load(
    tables: ResultTables, configured: ConfigurationData, ratio: Derived, nominal: float
) -> FullLoad | None:
    """Combine what a configuration's flights show of its battery; None if they show no sag."""
    sags = [f.sag for f in configured.flights if f.sag is not None]
    if not sags or not ratio.value:
        return None
    weights = np.array([one.drop_std**-2.0 for one in sags])
    drop = float(weights @ [one.drop for one in sags] / weights.sum())
    sag = BatterySag(
        voltage=float(np.mean([one.voltage for one in sags])),
        drop=drop,
        drop_std=float(weights.sum()) ** -0.5,
    )
    return FullLoad(
        speed=float(ratio.value) ** 0.5,
        sag=sag.held,
        nominal=nominal,
        exponent=_exponent_of_voltage(tables).value,
    )


def _exponent_of_voltage(tables: ResultTables) -> Measured:
    """Return the exponent of the voltage in the speed at one command, the usual one if unknown."""
    law = tables.command_law
    found = None if law is None else law.number("voltage_exponent")
    if found is None:
        return voltage_exponent(None)
    return voltage_exponent((found.value, 0.5 * (found.interval[1] - found.interval[0])))


def _open_share(tables: ResultTables, load: FullLoad) -> float:
    """Return half of a 95 % interval, over the thrust, by what is open of battery and motors."""
    exponent, sag = _exponent_of_voltage(tables), load.sag
    others = (
        replace(load, sag=replace(sag, drop=sag.drop + sag.drop_std)),
        replace(load, exponent=load.exponent + exponent.std),
        replace(load, load_exponent=load.load_exponent + LOAD_EXPONENT_STD),
    )
    shifts = [other.thrust / load.thrust - 1.0 for other in others]
    return 1.96 * float(np.linalg.norm(shifts))


def _thrust_to_weight(tables: ResultTables, ratio: Derived, load: FullLoad) -> Derived:
    """Return thrust at full throttle under load over the weight."""
    half = _half_share(ratio)
    by_law = replace(load, speed=load.speed * (1.0 + 0.5 * half)).thrust / load.thrust - 1.0
    return _under_load(tables, ratio, load, value=load.thrust, by_law=by_law)


def _max_thrust(tables: ResultTables, ratio: Derived, load: FullLoad) -> Derived:
    """Return the thrust of a motor at full throttle under load [N]."""
    full = next(d for d in tables.derived if d.name == "max_thrust")
    if full.value is None:
        return replace(full, name="max_thrust_loaded")
    value = full.value * load.thrust / load.speed**2
    return _under_load(tables, full, load, value=value, by_law=_half_share(full))


def _under_load(
    tables: ResultTables, free: Derived, load: FullLoad, *, value: float, by_law: float
) -> Derived:
    """Return a number under load, `by_law` being half of its interval by all but the battery."""
    by_battery = _open_share(tables, load)
    whole = float(np.hypot(by_law, by_battery))
    number = flight_number(f"{free.name}_loaded", free.configuration, value, whole * value)
    own = half_width_of_number(free.interval_terms)
    if number.std is None or own <= 0.0:
        return number
    sag = NumberTerm(name="battery sag", half_width=by_battery * value, source=SAG_SOURCE)
    terms = (*scale_terms(free.interval_terms, by_law * value / own), sag)
    return replace(number, interval_terms=terms)


def _half_share(number: Derived) -> float:
    """Return half of an interval over the value."""
    return 1.96 * number.std / abs(number.value) if number.value and number.std else 0.0


def _voltage_finding(nominal: float, loaded: float | None) -> Finding:
    """Say at which voltage full thrust holds."""
    sentence = (
        f"full thrust and thrust to weight are at {nominal:.3g} V; on another charge they "
        "change with about the voltage to the power of 1.6"
    )
    evidence = [Evidence(name=AT_COMMAND, value=nominal)]
    if loaded is not None:
        sentence += (
            f", and under full load, where this battery falls to about {loaded:.3g} V, they "
            "are less (thrust_to_weight_loaded, max_thrust_loaded)"
        )
        evidence.append(Evidence(name=UNDER_LOAD, value=loaded))
    return Finding(kind=VOLTAGE, severity="note", sentence=sentence, evidence=tuple(evidence))
