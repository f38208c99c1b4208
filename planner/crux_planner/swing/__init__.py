"""How a gripper gets from one grasp to the next: swings, which of them are free, and the links beside tall cuboids."""
