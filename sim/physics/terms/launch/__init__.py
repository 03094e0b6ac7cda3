"""Terms of the launch stage: how the wheels send the ball off."""
