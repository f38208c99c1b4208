"""What is proven of all plans: a lower bound of J, and that there is none."""
