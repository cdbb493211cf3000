"""Lag and delay of the motors, estimated with the fit."""
