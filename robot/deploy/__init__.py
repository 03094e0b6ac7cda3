"""The files that make a computer a robot that starts by itself. Texts only; `truearc/cli/robot/deploy.py` carries
them there."""
