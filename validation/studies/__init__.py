"""Questions that take many drives: the moose test, delay, random scenes, optimum, endurance, cost."""
