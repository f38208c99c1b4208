"""Plans again where a robot holds for a reason that another plan may avoid."""
