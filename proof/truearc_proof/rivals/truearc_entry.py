"""truearc's own finding as a claim like the others'."""

from typing import Any

from truearc_proof.rivals.claim import Claim
from truearc_proof.scoring.score_finding import names_ranked

NAMING = ("named", "set")             # verdicts that give names; "unknown" gives none, whatever it ranks


def claim_of(finding: dict[str, Any]) -> Claim:
    """finding: truearc.finding/1, decoded. Names count only where the verdict gives them."""
    fit = finding.get("fit") or {}
    before, after = fit.get("height_rmse_before_m"), fit.get("height_rmse_after_m")
    names = tuple(names_ranked(finding)) if finding["verdict"] in NAMING else ()
    return Claim(bool(finding["mismatch"]["found"]), names, before, before if after is None else after,
                 {} if finding["mismatch"]["p_value"] is None else {"p_value": float(finding["mismatch"]["p_value"])})
