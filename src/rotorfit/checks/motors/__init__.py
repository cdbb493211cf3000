"""Checks of motors and rotors: their limits, lag, law, a rotor that changed."""
