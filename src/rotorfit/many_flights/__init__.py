"""What several flights of one configuration show together, and one alone cannot."""
