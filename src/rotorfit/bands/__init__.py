"""Flights cut into frequency bands, and their factors at any timing of the motors."""
