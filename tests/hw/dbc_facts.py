"""What a codec's DBC file says of its messages, as cantools has it."""

from truearc.hw.codec import Codec


def messages(codec: Codec) -> tuple[str, ...]:
    """Names of all messages, in the file's order."""
    return tuple(codec._messages)


def length(codec: Codec, message: str) -> int:
    """Length of a message's data, in bytes."""
    return codec._messages[message].message.length


def limits(codec: Codec, message: str) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each signal of a message, in the DBC file's unit."""
    return {signal.name: (signal.minimum, signal.maximum) for signal in codec._messages[message].message.signals}


def is_float(codec: Codec, message: str, signal: str) -> bool:
    """Whether the signal is an IEEE float on the wire, rather than a scaled integer."""
    return bool(codec._messages[message].message.get_signal_by_name(signal).is_float)
