"""What a result should doubt about itself: every check that needs the fit, its flights, or both."""
