"""The motors' law in words, for the terminal and the page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.fit.experiment.toml_files import experiment_text

if TYPE_CHECKING:
    from rotorfit.results.command_law import CommandLaw

FORMULAS: Final = {
    "linear": "full_speed (offset + (1 - offset) u)",
    "power": "full_speed u^exponent",
    "offset power": "full_speed (offset + (1 - offset) u)^exponent",
    "sqrt": "full_speed sqrt(f u^2 + (1 - f) u), f = thr_mdl_fac",
}


def formula_of(law: CommandLaw) -> str:
    """Write the law's equation, u being the command."""
    voltage = ""
    if law.nominal_voltage is not None:
        voltage = f" (V / {law.nominal_voltage:.4g} V)^voltage_exponent"
    return f"speed = {FORMULAS.get(law.form, law.form)}{voltage}"


def law_sentences(law: CommandLaw) -> tuple[str, ...]:
    """Describe how well the law holds, and where it was seen."""
    best = min(law.held_out.values(), default=float("nan"))
    others = [
        f"{name} {error / best:.2g} times"
        for name, error in sorted(law.held_out.items(), key=lambda item: item[1])
        if name != law.form
    ]
    parts = [
        f"measured speeds are within {100.0 * law.relative_error:.2g} % of it (root mean square)"
        + (f"; other forms predict worse: {', '.join(others)} the error" if others else ""),
        f"commands in flight were {law.commands[0]:.2f} to {law.commands[1]:.2f}; outside, the "
        "law is extrapolated",
    ]
    factors = [f"{i} {f:.3f}" for i, f in enumerate(law.rotor_factors, 1) if f is not None]
    if len(factors) > 1:
        parts.append(f"speed of each rotor over the mean at the same command: {', '.join(factors)}")
    return tuple(parts)


def motors_lines(law: CommandLaw) -> tuple[str, ...]:
    """Write the TOML of ``[motors]`` for flights of this vehicle without rotor speed."""
    if not law.motors:
        return ()
    return tuple(experiment_text({"motors": law.motors}).splitlines())
