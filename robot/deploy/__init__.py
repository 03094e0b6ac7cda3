"""The files that make a computer a robot that starts by itself. Texts only; `truearc/cli/deploy.py` carries
them there."""
