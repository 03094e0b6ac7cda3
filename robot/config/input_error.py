"""The error of whoever gives wrong input; apart, for modules that the configuration's own parser needs."""


class InputError(Exception):
    """The user's file or option is wrong; the message names file, line, key or frame. Commands end with exit code 2."""
