"""The estimates row by row, and the paper's."""
