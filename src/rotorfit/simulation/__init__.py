"""The witness: flights with known truth; shares no line with the regressor."""
