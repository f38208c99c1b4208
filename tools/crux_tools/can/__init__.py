"""CAN interfaces of this machine: set up, checked, or, where the kernel has none, in a kernel of our own."""
