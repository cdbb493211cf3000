"""Blackbox logs of Betaflight, INAV and INDIflight."""
