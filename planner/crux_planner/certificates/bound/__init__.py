"""A proven lower bound of J (6): what makes the gap of a plan a fact."""
