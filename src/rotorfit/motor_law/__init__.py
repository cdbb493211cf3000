"""From commands and the speeds that answer them to the motors' law, lag and delay."""
