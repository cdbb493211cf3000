"""What contradicts a model motor or rotor: their limits, lag, law, a rotor that changed."""
