"""Instrumental variables: what pilot or mission asked for, which gusts do not reach."""
