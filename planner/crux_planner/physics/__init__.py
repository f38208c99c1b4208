"""The terms of P1: dynamics, contact forces, reach, torques, bounds and J, one physical idea a file.

Equation numbers are those of Shirai et al. 2022 (planner/README.md).
"""
