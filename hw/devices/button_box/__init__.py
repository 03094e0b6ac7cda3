"""The operator's button box on a serial port."""
