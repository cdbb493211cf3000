"""A file to a FlightLog; one module per format."""
