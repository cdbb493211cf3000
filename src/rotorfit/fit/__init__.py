"""From declared flights to estimated numbers with intervals: timing, equations, likelihood."""
