"""What is known after a fit: a result with its flights and findings, saved and loaded."""
