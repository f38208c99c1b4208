"""The terms of P1, one physical idea a file; equation numbers are those of Shirai et al. 2022 (planner/README.md)."""
