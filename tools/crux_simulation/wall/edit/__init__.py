"""`crux wall edit`: a page in the browser to draw a wall, with what the planner says of it."""
