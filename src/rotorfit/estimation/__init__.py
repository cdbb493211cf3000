"""Algebra on arrays; knows no drone."""
