"""A fleet, top to bottom: logs to entries, entries to rows, rows to files."""
