"""Terms of the arrival stage: the target's opening."""
