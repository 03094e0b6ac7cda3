"""The film tracker: clips of a still camera -> flights of balls in metres, matched to the shots of a recording."""
