"""The recipe: from an experiment to a result with verdicts."""
