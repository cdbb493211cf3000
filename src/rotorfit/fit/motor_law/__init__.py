"""From commands and the measured speeds to the motors' law, lag and delay."""
