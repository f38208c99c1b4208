"""`crux robot`: bring a robot description in, and check what a robot can do."""
