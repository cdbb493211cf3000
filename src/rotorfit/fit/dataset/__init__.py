"""The flights of an experiment, read, prepared and screened."""
