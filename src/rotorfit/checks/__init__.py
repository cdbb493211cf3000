"""What contradicts the declaration or the data: refusals before the fit, doubts after it."""
