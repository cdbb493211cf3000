"""When the rotors do what the motor data say: lag and delay, found with the fit."""
