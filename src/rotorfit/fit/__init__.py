"""From declared flights to estimated numbers with intervals: factors, equations, likelihood."""
