"""The law of commanded motors by the flight, and what it leaves open of the numbers."""
