"""A small dataset as text, for tests that break it."""

from pathlib import Path

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Target, Wheel

RIG = """
[ball]
mass_kg = 0.14
radius_m = 0.0889
[target]
centre_height_m = 2.44
"""
HEADER = "shot_id,distance_m,hood_deg,motor_ratio,outcome,side,session,temperature_c"
GOOD = "a,3.0,50.0,0.5,three,,day1,20.5"
FACTS = Rig(ball=Ball(0.14, 0.0889), launcher=LauncherFacts(0.75, 594.0, (Wheel("lower", 0.05, 1.0, 180.0),)),
              target=Target(2.44))


def write(home: Path, shots: str, rig: str = RIG, **others: str) -> Path:
    (home / "rig.toml").write_text(rig, encoding="utf-8")
    for name, text in {"shots": shots, **others}.items():
        (home / f"{name}.csv").write_text(text, encoding="utf-8")
    return home
