"""Defaults and limits of discovery, in a module without heavy imports: the command line shows them in --help."""

from truearc.errors import InputError

FALSE_ALARM = 0.05
SIGN_DRAWS = 1999                     # sign flips behind a p-value, which is therefore 1 / 2000 at least
LEAST_FALSE_ALARM = 0.002             # a p of at least 1 in 1000 can decide about it
LEVELS = ("L0", "L1", "L2")           # outcomes | with telemetry | with tracks
LEVEL = "L0"
SEASON_SHOTS = 300                    # of a planned season
PLANNED_SHOTS, CONFIGURATIONS = 100, 5    # of a design


def check_chances(false_alarm: float, seed: int, names: tuple[str, str] = ("false_alarm", "seed")) -> None:
    """Refuse what no discovery can be run with.

    Raises:
        InputError: names the argument, by `names`: a false alarm not from LEAST_FALSE_ALARM to 1, or a negative seed.
    """
    if not LEAST_FALSE_ALARM <= false_alarm < 1.0:
        raise InputError(f"{names[0]}: {false_alarm} is not between {LEAST_FALSE_ALARM} (rarer alarms would take more "
                         "draws than are made) and 1")
    if seed < 0:
        raise InputError(f"{names[1]}: {seed} is negative")
