"""The reasons that only a sample motor can have: their texts in the log and on the operator page."""

from truearc.hw.reason import FAULT, Code, Message

WRONG_FIRMWARE = Code("samplemotor.wrong_firmware",
                      "{motor:~: }samplemotor node {node} has firmware {firmware}, expected {wanted}",
                      {"motor": "motor?", "node": "count", "firmware": "count", "wanted": "count"})
SUPPLY_LOW = Code("samplemotor.supply_low", "supply low")
MESSAGES = (Message(WRONG_FIRMWARE, FAULT, "{motor}: unsupported firmware {firmware}", "update it to {wanted}"),
            Message(SUPPLY_LOW, FAULT, "{motor}: supply low", "battery charged?"))
