"""ODrive S1 and Pro motor controllers over CAN."""
