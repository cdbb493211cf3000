"""The user's declarations: the experiment file, its airframe, motors, payloads and terms."""
