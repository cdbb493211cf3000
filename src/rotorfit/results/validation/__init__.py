"""Validate a result on other flights: wrenches predicted, rates replayed."""
