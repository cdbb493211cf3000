"""What is known after a fit: parameters with verdicts, in tables that save and load."""
