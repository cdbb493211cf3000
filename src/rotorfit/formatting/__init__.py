"""Results, logs and plans as text on one screen, in a notebook, as a data frame."""
