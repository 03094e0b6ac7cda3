"""Names of the errors in a CAN controller's error frame; bits as in linux/can/error.h."""

BUS_OFF = "bus off"
OVERRUN = "receive overrun"

CLASSES = ((0x001, "transmit timeout"), (0x002, "arbitration lost"), (0x008, "protocol violation"),
           (0x010, "transceiver"), (0x020, "no acknowledgement"), (0x040, BUS_OFF), (0x080, "bus error"),
           (0x100, "restarted"))
CONTROLLER = 0x004                                # details are in the second byte
CONTROLLER_DETAILS = ((0x01, OVERRUN), (0x02, "transmit overrun"), (0x04, "many receive errors"),
                      (0x08, "many transmit errors"), (0x10, "error passive"), (0x20, "error passive"),
                      (0x40, "error active again"))


def error_words(arbitration_id: int, data: bytes) -> tuple[str, ...]:
    """What one error frame says; never empty."""
    words = [word for bit, word in CLASSES if arbitration_id & bit]
    if arbitration_id & CONTROLLER:
        details = data[1] if len(data) > 1 else 0
        words += [word for bit, word in CONTROLLER_DETAILS if details & bit] or ["controller"]
    return tuple(dict.fromkeys(words)) or ("of an unknown kind",)
