"""The contact block: which limb moves when to which hold, over which way, and where the body is meanwhile."""
