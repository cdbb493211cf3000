"""What one log could tell, without an airframe and before any fit."""
