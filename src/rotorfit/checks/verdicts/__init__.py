"""The verdict on every number of a fit, why it is not better, and what to fly."""
