"""What pilot or mission asked for, as a witness of the estimate that gusts do not reach."""
