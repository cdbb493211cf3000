"""Which part of a flight is in the air."""
