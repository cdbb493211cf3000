"""From estimates to numbers with 95 % intervals."""
