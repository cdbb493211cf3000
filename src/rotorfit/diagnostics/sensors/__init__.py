"""What gyro, accelerometer and motion capture did to the record: clocks, filters, tilt, faults."""
