"""What runs beside the control loop: vision, recorder, watchdog and tick timing."""
