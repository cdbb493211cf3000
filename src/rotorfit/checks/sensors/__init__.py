"""Checks of gyro, accelerometer and motion capture: clocks, filters, settings, faults."""
