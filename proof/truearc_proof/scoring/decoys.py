"""Worlds with a decoy: something that changes much and does nothing, so that its name is false, whatever it resembles.

Marks keep what the data cannot tell apart, the decoy's name with it; here it is put right, for older rounds too.
"""

from truearc_proof.scoring.score_world import Mark
from truearc_proof.scoring.suite import unseen
from truearc_proof.worlds.sampling_plan import DECOY, OWN


def named_decoy(mark: Mark) -> bool | None:
    """Return whether the decoy's name comes first, alone or in a set.

    None in other worlds, and where the level's data have nothing of the decoy.
    """
    return None if _absent(mark) else mark.names[:1] == (DECOY,)


def has_decoy(mark: Mark) -> bool | None:
    """Whether its name is among those that are said."""
    return None if _absent(mark) else DECOY in mark.names


def up_to_alias(mark: Mark) -> bool | None:
    """Whether the first name is right or of a class with the right one, and no decoy's."""
    return mark.alias and not named_decoy(mark)


def _absent(mark: Mark) -> bool:
    return mark.engine == OWN or mark.kind != "decoy" or DECOY in unseen(mark.level)
