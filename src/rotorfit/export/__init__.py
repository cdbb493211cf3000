"""A result to the files of other tools."""
