"""One HTML page about a plan or a climb: `crux report`."""
