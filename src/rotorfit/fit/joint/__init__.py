"""All equations of all configurations in one likelihood."""
