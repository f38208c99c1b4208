"""Every equation of docs/mathematics.md, written anew in NumPy, against planner, checker and runtime.

A test of equation (8a) is called test_equation_8a_...; test_page.py holds that every equation of the page has one.
"""
