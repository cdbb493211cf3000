"""Motion capture: its frames, its clock, and the motion that they show."""
