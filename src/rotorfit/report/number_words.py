"""Parameters in words, verdicts in words, numbers with their intervals."""

from rotorfit.formatting.digits import finite_interval, known
from rotorfit.model.parameters import DRAG_MOMENTS
from rotorfit.results.result import Derived, Parameter

TITLES = {
    "kt": "Thrust coefficient of a rotor",
    "kd": "Drag torque coefficient of a rotor",
    "Jr": "Spin inertia of a rotor",
    "motor_lag": "Motor lag (time constant)",
    "motor_lag_up": "Motor lag, rising speed",
    "motor_lag_down": "Motor lag, falling speed",
    "motor_delay": "Motor delay",
    "command_delay": "Delay from command to measured speed",
    "max_speed": "Rotor speed at full command",
    "mass": "Mass",
    "com_x": "Centre of mass, forward",
    "com_y": "Centre of mass, to the left",
    "com_z": "Centre of mass, up",
    "Ixx_com": "Roll inertia about the CoM",
    "Iyy_com": "Pitch inertia about the CoM",
    "Izz_com": "Yaw inertia about the CoM",
    "Ixy_com": "Product of inertia xy about the CoM",
    "Ixz_com": "Product of inertia xz about the CoM",
    "Iyz_com": "Product of inertia yz about the CoM",
    "msx": "First moment x (mass times CoM x)",
    "msy": "First moment y (mass times CoM y)",
    "msz": "First moment z (mass times CoM z)",
    "Ixx": "Roll inertia at the origin",
    "Iyy": "Pitch inertia at the origin",
    "Izz": "Yaw inertia at the origin",
    "Ixy": "Product of inertia xy at the origin",
    "Ixz": "Product of inertia xz at the origin",
    "Iyz": "Product of inertia yz at the origin",
    "rotor_center_x": "Rotor centre from the IMU, forward",
    "rotor_center_y": "Rotor centre from the IMU, to the left",
    "twist": "Yaw torque over thrust (motors tilted about their arms)",
    "rotor_drag": "In-plane drag of a rotor over its two speeds",
    "drag_x": "Air drag of the frame, forward",
    "drag_y": "Air drag of the frame, to the left",
    "drag_z": "Air drag of the frame, up",
    **{
        name: f"Torque of the air about {name[-2]} per velocity along {name[-1]}"
        for name in DRAG_MOMENTS
    },
    "turn_damping_x": "Damping of roll by the air",
    "turn_damping_y": "Damping of pitch by the air",
    "inflow": "Thrust lost over rotor speed and climb",
    "translational_lift": "Thrust over the squared sideways velocity",
    "torque_offset_x": "Constant torque about x",
    "torque_offset_y": "Constant torque about y",
    "torque_offset_z": "Constant torque about z",
    "accel_bias_x": "Accelerometer bias x",
    "accel_bias_y": "Accelerometer bias y",
    "accel_bias_z": "Accelerometer bias z",
    "kd_over_kt": "Drag torque over thrust",
    "kd_over_Izz": "Yaw acceleration per rotor speed squared",
    "Jr_over_Izz": "Yaw acceleration per rotor acceleration",
    "Ixx_over_kt": "Roll inertia over thrust coefficient",
    "Iyy_over_kt": "Pitch inertia over thrust coefficient",
    "Izz_over_kt": "Yaw inertia over thrust coefficient",
    "hover_speed": "Rotor speed in hover",
    "motor_lag_total": "Motor lag and delay together",
}

VERDICT_MEANING = {
    "identified": "uncertainty up to 25 % of the value or its relevant size (docs/method.md)",
    "weak": "uncertainty over 25 % of value and relevant size, or mostly prior (marked so)",
    "ratio-only": "known only together with another parameter",
    "not-identified": "this flight does not show it",
    "given": "given to rotorfit, not estimated",
    "removed": "taken out of the model as unessential",
}

PREDICTED_WELL = (
    "Good: Fz up to 5 % (the weight is in it), moments up to 30 % (a tenth of their power is left)."
)
"""What relative errors on flights kept apart are worth."""
NOTHING_PREDICTED = (
    "At 100 % and over the model predicts nothing of that component: the rotors hardly moved it "
    "in this flight (validate on one that does), or the parameters do not hold for it (vehicle "
    "changed since, wrong configuration; identify from both flights)."
)


def title_of(name: str) -> str:
    """Return a parameter's name in words."""
    base, _, number = name.rpartition("_")
    if name in TITLES:
        return TITLES[name]
    if base in TITLES and number.isdigit():
        return TITLES[base].replace("a rotor", f"rotor {number}")
    return name


def unit_words(unit: str) -> str:
    """Return a unit with raised powers; nothing for a plain number."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def half_width(number: Parameter | Derived) -> float | None:
    """Return half of the interval."""
    interval = finite_interval(number.interval)
    return None if interval is None else 0.5 * (interval[1] - interval[0])


def percent(number: Parameter | Derived) -> float | None:
    """Return the half-width relative to the value [%]; silly where the value is near zero."""
    half, value = half_width(number), known(number.value)
    return None if half is None or not value else 100.0 * half / abs(value)


def percent_words(value: float) -> str:
    """Return a percentage with two digits, or whole above 10."""
    if value >= 9.5:
        return f"{value:.0f} %"
    if value < 0.001:
        return "0.001 %"
    return f"{float(f'{value:.1g}' if value < 1 else f'{value:.2g}'):g} %"
