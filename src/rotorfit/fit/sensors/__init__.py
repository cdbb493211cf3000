"""Errors of gyro and velocity, and filters on board: what they leave open of the numbers."""
