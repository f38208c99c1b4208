"""Is this machine fit to be the robot's computer? `crux preflight`."""
