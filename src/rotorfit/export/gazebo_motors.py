"""Gazebo's MulticopterMotorModel, one plugin per rotor (gz-sim 6 and newer).

Names, units and signs are those of gz-sim, src/systems/multicopter_motor_model/
MulticopterMotorModel.cc: thrust = motorConstant w^2 along z of the rotor's link; torque on the
parent link = -turningDirection momentConstant thrust (ccw: +1); the speed follows its command with
timeConstantUp or timeConstantDown, whichever way it goes. The two coefficients of rotor drag, which
are left out, have defaults other than zero there, and are written as zero. The place of a rotor in
the commands is motorNumber in gz-sim 6, and actuator_number in newer ones, which warn of the
former: both are written.
"""

from collections.abc import Sequence

from rotorfit.export.header import noted, xml_comment
from rotorfit.export.units import text
from rotorfit.export.vehicle import LAG, ROTORS, SPEED, ExportedRotor, VehicleModel

NEEDS = (*ROTORS, *LAG, *SPEED)
SLOWDOWN = 10.0
"""rotorVelocitySlowdownSim: the joint turns so many times slower than the rotor, so that its angle
does not alias."""


def write_gazebo_motors(model: VehicleModel, head: Sequence[str]) -> str:
    """Return the plugins of all rotors, to be pasted into an SDF model."""
    comment = noted(
        head,
        "paste into <model>; joints rotor_N_joint and links rotor_N are numbered as the log's "
        "motors, from 0",
        "motorConstant in N s^2/rad^2, momentConstant = kd/kt in m, times in s, speed in rad/s",
    )
    return xml_comment(comment) + motor_plugins(model)


def motor_plugins(model: VehicleModel) -> str:
    """Return one plugin per rotor."""
    return "".join(_plugin(i, rotor, model) for i, rotor in enumerate(model.rotors))


def _plugin(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    fields = (
        ("jointName", f"rotor_{i}_joint"),
        ("linkName", f"rotor_{i}"),
        ("turningDirection", "ccw" if rotor.spin > 0 else "cw"),
        ("timeConstantUp", text(model.lag_up)),
        ("timeConstantDown", text(model.lag_down)),
        ("maxRotVelocity", text(model.max_speed)),
        ("motorConstant", text(rotor.kt)),
        ("momentConstant", text(model.kd / rotor.kt)),
        ("commandSubTopic", "command/motor_speed"),
        ("motorNumber", str(i)),
        ("actuator_number", str(i)),
        ("rotorDragCoefficient", "0"),
        ("rollingMomentCoefficient", "0"),
        ("rotorVelocitySlowdownSim", text(SLOWDOWN)),
        ("motorType", "velocity"),
    )
    inner = "".join(f"      <{name}>{value}</{name}>\n" for name, value in fields)
    return (
        '    <plugin filename="gz-sim-multicopter-motor-model-system"\n'
        '            name="gz::sim::systems::MulticopterMotorModel">\n'
        f"{inner}    </plugin>\n"
    )
