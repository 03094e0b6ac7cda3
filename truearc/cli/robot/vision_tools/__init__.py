"""The work behind `truearc vision`, `vision-calibrate` and `vision-tune`."""
