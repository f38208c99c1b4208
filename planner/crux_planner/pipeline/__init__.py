"""From a scenario to a checked plan: attempts and fallbacks, planning again, messages, and why there is no plan."""
