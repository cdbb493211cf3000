"""What a controller asks of the vehicle: control effectiveness, newton per unit of a setpoint."""
