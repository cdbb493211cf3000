"""What the logs themselves say of vehicle and motors, beside the experiment file."""

from collections.abc import Sequence
from pathlib import Path

from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.diagnostics.filtered_imu import lowpass_sentence
from rotorfit.errors import ExperimentError
from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.logs.flight_log import SITL, simulated_sentence
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve


def agreed_motors(declared: MotorsEntry, flights: Sequence[LoadedFlight]) -> MotorsEntry:
    """Return the motors of all flights: as declared, completed by the logs' parameters.

    Raises
    ------
    ExperimentError
        If the logs complete them differently.
    """
    if not flights:
        return declared
    first = flights[0]
    for other in flights:
        if other.motors != first.motors:
            one, two = (Path(f.entry.file).name for f in (first, other))
            raise ExperimentError(
                f"{one} and {two} have other motor parameters in their logs "
                f"({_words(first)}; {_words(other)}), and [motors] has no law: give the one that "
                "holds for all, or identify them apart"
            )
    return first.motors


def _words(flight: LoadedFlight) -> str:
    told = flight.log.motors
    return "none" if told is None else told.words


def log_metadata_notes(declared: MotorsEntry, dataset: Dataset) -> tuple[str, ...]:
    """Return what was taken from the logs, and which of them no vehicle flew, in words."""
    flights = [flight for c in dataset.configurations for flight in c.flights]
    said = [simulated_sentence(f.log.simulator) for f in flights if f.log.simulator]
    said += [_yaw_of_sitl(f) for f in flights if f.log.simulator == SITL]
    said.append(lowpass_sentence(dataset) or "")
    told = flights[0].log.motors
    if told is not None and declared.law is None and dataset.motors.law is not None:
        battery = ""
        if dataset.motors.law.voltage is not None:
            battery = f", at {dataset.motors.law.voltage.nominal:g} V"
        said.append(
            f"the law from command to rotor speed is the one in the log ({told.words}{battery}): "
            "only as good as these settings; a law under [motors] replaces it"
        )
    return tuple(dict.fromkeys(word for word in said if word))


def _yaw_of_sitl(flight: LoadedFlight) -> str:
    """Return by how much its yaw torque changes more than one that goes with squared speed.

    With thrust T = (1 - f) c + f c^2 of a command c, and torque in proportion to c T, the torque
    changes with T by c + T / T', where the mean is c.
    """
    law = flight.motors.law
    if law is None or law.sqrt is None:
        return ""
    curve = ThrustCurve(factor=law.sqrt.thr_mdl_fac, error=0.0)
    thrust = float((flight.prepared.motor_channel**2).mean()) / law.sqrt.full_speed**2
    c, f = curve.command(thrust), curve.factor
    more = 1.0 + thrust / (c * (1.0 - f + 2.0 * f * c))
    return (
        f"its yaw torque changes {more:.2f} times as much as a torque proportional to thrust "
        f"would: kd, kd/kt and kd/Izz describe changes about hover, {more:.2f} times "
        "their values in hover"
    )
