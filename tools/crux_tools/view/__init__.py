"""The viewer of logs, plans and running climbs: `crux view`, `crux watch` and the view of `crux replay`."""
