"""What a simulation foretells where the balls are the ones that were believed in.

A later session's balls may be others, and a fit that may say so puts much of a change of the robot down to them: on
shots of that session it foretells no worse for it. But the next session's balls are others again. So what is to be
believed is judged with the session's luck of balls taken out: what would then foretell its shots surely worse is not
believed, be it that this session's balls gain by it; and what they do not gain by is, if it is not surely worse.
"""

import numpy as np

from truearc.sim.discover.detect.clusters import Clusters
from truearc.sim.discover.model.score_table import Array, ScoreTable
from truearc.sim.discover.select.refit import clustered_error, unseen_change

NINETY = 1.645


def luck_of_others(evidence: ScoreTable) -> Array:
    """Places of the columns of a later session's balls; none where nothing was believed of earlier ones."""
    return np.array([k for k, column in enumerate(evidence.columns) if column.kind == "group" and column.told],
                    dtype=int)


def usual_score(evidence: ScoreTable, clusters: Clusters) -> Array:
    """Log score [n] of each shot by fits of all columns to the other folds, had the balls been as believed."""
    change, luck = unseen_change(evidence, clusters), luck_of_others(evidence)
    change[:, luck] = -evidence.point[luck]
    return np.asarray(evidence.log_score + evidence.gain(change))


def usual_gain(before: ScoreTable, after: ScoreTable, clusters: Clusters) -> tuple[float, float]:
    """90 % interval of the log score that a shot gains by `after` in place of `before`, columns all shared in both."""
    gain = usual_score(after, clusters) - usual_score(before, clusters)
    error = NINETY * clustered_error(gain, clusters.label[after.rows])
    return float(gain.mean() - error), float(gain.mean() + error)
