"""A flight to triangular factors, per frequency band and at any timing of the motors."""
