"""The physics: the vehicle, its parameters, and the constant tensors of its equations."""
