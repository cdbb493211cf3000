"""Tools around the fit: inspect a log, plan a flight, judge the rate loop, identify a fleet."""
