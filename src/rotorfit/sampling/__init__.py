"""Bodies and rotors drawn from the joint posterior, each of which can exist."""
