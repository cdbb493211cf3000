"""How accurate the estimates are, against the Cramer-Rao bound of the flights themselves."""
