"""A FlightLog to one clock, SI units and body axes."""
