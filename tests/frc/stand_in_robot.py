"""A stand-in robot program: plain pyntcore, 50 Hz, sensors with noise. `python stand_in_robot.py PORT SECONDS [KEY
AFTER_S]`, after which it no longer publishes KEY; it knows nothing of truearc, and prints what it reads of /truearc."""

import json
import math
import random
import sys
import time

import ntcore

WELL = {"/Vision/Distance": 2.2488, "/Hood/Angle": 51.737, "/Shooter/RPM": 0.44958 * 594.0 * 9.549297, "/Battery": 12.4}
NOISE = {"/Vision/Distance": 0.004, "/Hood/Angle": 0.02, "/Shooter/RPM": 3.0, "/Battery": 0.02}
HZ = 50


def main(port: int, seconds: float, key: str = "", after_s: float = 0.0) -> None:
    instance = ntcore.NetworkTableInstance.create()
    instance.startServer("", "127.0.0.1", 0, port)
    publishers = {name: instance.getDoubleTopic(name).publish() for name in WELL}
    verdict = instance.getStringTopic("/truearc/verdict").subscribe("none", ntcore.PubSubOptions(
        periodic=0.01, sendAll=True, keepDuplicates=True, pollStorage=100_000))
    age = instance.getDoubleTopic("/truearc/age_s").subscribe(math.nan, ntcore.PubSubOptions(
        periodic=0.01, sendAll=True, keepDuplicates=True, pollStorage=100_000))
    draw = random.Random(1)
    began = time.monotonic()
    began_us = ntcore._now()
    due = began
    heard, ages = [], []
    while (since_s := time.monotonic() - began) < seconds:
        for name, publisher in list(publishers.items()):
            publisher.set(WELL[name] + draw.gauss(0.0, NOISE[name]))
            if name == key and since_s >= after_s:
                publishers.pop(name).close()
        instance.flush()
        heard += [((one.time - began_us) * 1e-6, one.value) for one in verdict.readQueue()]
        ages += [one.value for one in age.readQueue()]
        due += 1.0 / HZ
        time.sleep(max(due - time.monotonic(), 0.0))
    print(json.dumps({"heard": heard, "ages": ages}))


if __name__ == "__main__":
    port, seconds, key, after_s = [*sys.argv[1:], "", "0"][:4]
    main(int(port), float(seconds), key, float(after_s))
