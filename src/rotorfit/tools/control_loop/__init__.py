"""The rate loop as flown: controller and vehicle, their open loop, its margins, its proof."""
