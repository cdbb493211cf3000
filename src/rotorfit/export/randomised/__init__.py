"""Vehicles drawn from the posterior, as files that simulators randomise with."""
