"""Fits with another declaration, or of a part of the flights, as evidence for the checks."""
