"""Many logs of many vehicles, each identified once: one row a flight, one row a vehicle."""
