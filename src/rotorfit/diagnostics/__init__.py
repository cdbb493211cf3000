"""What the likelihood does not know: steps that widen a fit, and checks that contradict it."""
