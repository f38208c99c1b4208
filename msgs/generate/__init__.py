"""Generator of everything that is derived from the contracts in msgs/: C, C++, Python and ros2msg."""
