"""The page on which a log is dropped: its engine, and the server that shows it on this computer."""
