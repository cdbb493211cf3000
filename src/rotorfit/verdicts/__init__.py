"""How well every number of a fit is known: its verdict, why not better, and what to fly."""
