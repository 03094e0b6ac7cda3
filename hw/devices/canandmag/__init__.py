"""Redux Canandmag absolute encoder over CAN."""
