"""The files that make a computer a robot that starts by itself. Texts only; `doors/deploy.py` carries them there."""
