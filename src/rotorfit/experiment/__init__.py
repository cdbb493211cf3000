"""What the user declares: the experiment file, its airframe, motors, payloads and terms."""
