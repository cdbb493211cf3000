"""What the physics says: the vehicle, its parameters, and the constant tensors of its equations."""
