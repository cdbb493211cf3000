"""Consistency checks of a fit and its flights: what contradicts the result."""
