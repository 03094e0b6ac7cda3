"""A fictitious motor controller on CAN, as a motor family of truearc."""
