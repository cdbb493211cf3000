"""What the autopilots' own simulators leave out: their flights are no vehicle's."""

from typing import Final

SIH: Final = "PX4 SIH"
GAZEBO: Final = "Gazebo under PX4"
PX4_OTHER: Final = "a simulator under PX4"
SITL: Final = "ArduPilot SITL"

LEAVES_OUT: Final[dict[str, str]] = {
    SIH: "thrust and torque are proportional to the motor signal, and the lag acts on them, not on "
    "a speed, in steps of its loop: it is SIH_T_TAU less half a step (2 ms at 250 Hz); no rotor "
    "inertia, no voltage, "
    "the CoM in the middle of the rotors",
    GAZEBO: "the motors' plugin has its own constants: rising and falling time, thrust, moment, "
    "rotor drag; no battery in the thrust",
    PX4_OTHER: "what it leaves out is not known here",
    SITL: "its own frames (not Gazebo and others behind it) turn by torque over inertia, axis by "
    "axis, without gyroscopic terms and products of inertia; no motor lag, no rotor inertia; "
    "yaw torque is proportional to command times thrust",
}
"""By the simulator's name."""


def simulated_sentence(simulator: str) -> str:
    """Return that a flight is none of a real vehicle, and what its simulator leaves out."""
    return f"flown in {simulator}, a simulator: {LEAVES_OUT[simulator]}"
