"""A made-up motor controller on CAN, as a motor family of truearc."""
