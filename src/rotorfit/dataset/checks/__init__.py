"""What contradicts the declaration before any fit: axes, units, rotors, telemetry; refused."""
