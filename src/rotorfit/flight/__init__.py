"""FlightLog to FlightData: one clock, SI units, body axes, the airborne part."""
