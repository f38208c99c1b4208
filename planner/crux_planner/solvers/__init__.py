"""Solvers and what they run on: QPs, MILPs, relaxed binaries, worker processes and the clock of their work."""
