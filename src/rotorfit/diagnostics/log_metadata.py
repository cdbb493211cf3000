"""Note what the logs themselves say of vehicle and motors, beside the experiment file."""

from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.diagnostics.sensor_faults import lowpass_sentence
from rotorfit.experiment.experiment import MotorsEntry
from rotorfit.findings import Finding, note
from rotorfit.logs.flight_log import SITL, simulated_sentence
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve


def log_metadata(declared: MotorsEntry, dataset: Dataset) -> tuple[Finding, ...]:
    """Note what was taken from the logs, and which of them a simulator flew."""
    flights = [flight for c in dataset.configurations for flight in c.flights]
    simulated = [simulated_sentence(f.log.simulator) for f in flights if f.log.simulator]
    yaw = [_yaw_of_sitl(f) for f in flights if f.log.simulator == SITL]
    logged, law = flights[0].log.motors, ""
    if logged is not None and declared.law is None and dataset.motors.law is not None:
        battery = ""
        if dataset.motors.law.voltage is not None:
            battery = f", at {dataset.motors.law.voltage.nominal:g} V"
        law = (
            f"the law from command to rotor speed is the one in the log ({logged.words}{battery}): "
            "only as good as these settings; a law under [motors] replaces it"
        )
    every = [*simulated, *yaw, lowpass_sentence(dataset) or "", law]
    return tuple(note("log-metadata", sentence) for sentence in dict.fromkeys(every) if sentence)


def _yaw_of_sitl(flight: LoadedFlight) -> str:
    """Explain by how much SITL's yaw torque changes more than one proportional to squared speed.

    With thrust T = (1 - f) c + f c^2 of a command c, and torque proportional to c T, the torque
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
