"""Plans again where a robot holds for a cause that planning can mend."""
