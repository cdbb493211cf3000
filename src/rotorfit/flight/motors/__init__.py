"""Motor channels: commands to rotor speed, telemetry, lag and delay."""
