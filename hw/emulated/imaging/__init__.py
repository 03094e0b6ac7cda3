"""An emulated phone beside the launcher, which films flights; it shares no code with the tracker of clips."""
