"""What a diagnosis tells a calibration: tests of the effects freed in it, and a second estimate by its filter."""
