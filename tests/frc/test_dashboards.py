"""Layouts of dashboards show topics that are published."""

import json
from pathlib import Path

from truearc_frc.keys import OURS

DASHBOARDS = Path(__file__).parents[2] / "examples" / "dashboards"
LAYOUT = DASHBOARDS / "elastic.json"
PUBLISHED = {"p_two", "p_three", "verdict", "reasons", "novelty", "hood_deg", "wheel_rad_s", "correction", "age_s",
             "lead_deg"}


def test_elastic_shows_every_topic_once_without_overlap() -> None:
    (tab,) = json.loads(LAYOUT.read_text(encoding="utf-8"))["tabs"]
    boxes = tab["grid_layout"]["containers"]
    assert sorted(box["properties"]["topic"] for box in boxes) == sorted(OURS + name for name in PUBLISHED)
    cells = [(x, y) for box in boxes for x in range(int(box["x"]), int(box["x"] + box["width"]), 128)
             for y in range(int(box["y"]), int(box["y"] + box["height"]), 128)]
    assert len(cells) == len(set(cells))


def test_advantagescope_draws_every_topic_once_by_its_type() -> None:
    layout = json.loads((DASHBOARDS / "advantagescope-live.json").read_text(encoding="utf-8"))
    (hub,) = layout["hubs"]
    drawn = [one for tab in hub["state"]["tabs"]["tabs"] if tab["type"] == 1             # line graphs
             for side in ("leftSources", "rightSources", "discreteSources") for one in tab["controller"][side]]
    assert sorted(one["logKey"] for one in drawn) == sorted(f"NT:{OURS}{name}" for name in PUBLISHED)
    types = {"verdict": "String", "reasons": "StringArray"}
    assert all(one["logType"] == types.get(one["logKey"].removeprefix(f"NT:{OURS}"), "Number") for one in drawn)
