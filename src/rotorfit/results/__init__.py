"""The result of a fit with its flights and findings, saved and loaded."""
