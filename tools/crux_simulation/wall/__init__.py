"""Walls from scans: a mesh or a height map becomes a scenario, with the holds that a gripper can take as cuboids."""
