"""A wheel that knows its own numbers: the exact solution of the straight law, and noise."""

import numpy as np

from truearc.sim.sysid.fit import Record

KS, KV, KA, DELAY_S = 0.4, 0.009, 0.0045, 0.03
TRUTH = {"ks": KS, "kv": KV, "ka": KA, "delay_s": DELAY_S}
STAIRS = (2.0, 4.0, 3.0, 6.0, 5.0, 2.5, 4.5, 6.0)
STAIR_S, PERIOD_S = 2.5, 0.02


def exact_speed(t_s, efforts=STAIRS, ks=KS, kv=KV, ka=KA):
    """Speed at times `t_s` of a wheel that starts from rest and is given each effort for STAIR_S, by exponentials."""
    speed, out = 0.0, np.zeros(len(t_s))
    for number, effort in enumerate(efforts):
        final, since = (effort - ks) / kv, t_s - number * STAIR_S
        mine = (since >= 0.0) & (since <= STAIR_S) if number + 1 < len(efforts) else since >= 0.0
        out[mine] = final + (speed - final) * np.exp(-since[mine] * kv / ka)
        speed = final + (speed - final) * np.exp(-STAIR_S * kv / ka)
    return out


def stair_record(noise_rad_s, seed=0, delay_s=DELAY_S, effort_rows=True):
    """The steps as a user would record them; without `effort_rows` only the changes of effort are noted."""
    t_s = np.arange(0.0, len(STAIRS) * STAIR_S, PERIOD_S)
    efforts = np.array(STAIRS)[np.minimum((t_s / STAIR_S + 1e-9).astype(int), len(STAIRS) - 1)]
    speed = exact_speed(t_s - delay_s) + noise_rad_s * np.random.default_rng(seed).standard_normal(len(t_s))
    if effort_rows:
        return Record("stairs", "v", t_s, efforts, t_s, speed)
    return Record("stairs", "v", np.arange(len(STAIRS)) * STAIR_S, np.array(STAIRS), t_s, speed)
