"""What one log can show, without an airframe and before any fit."""
