"""Errors outside the likelihood: steps that widen a fit, and checks that contradict it."""
