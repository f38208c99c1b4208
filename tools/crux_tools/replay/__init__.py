"""A logged climb in figures and in a 3-D view: `crux replay`."""
