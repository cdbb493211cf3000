"""A result to text, figures and pages."""
