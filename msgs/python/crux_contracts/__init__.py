"""What crux's programs must agree on, in Python: robots, scenarios, plans, channels and the CAN codec."""

LIMB_NAMES = ("LF", "RF", "LR", "RR")
"""The limb order used everywhere."""
N_LIMBS = len(LIMB_NAMES)
