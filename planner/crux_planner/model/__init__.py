"""A scenario and a robot in numbers: P1, its grasps and footholds, kinematics, masses, shapes, gaits and schedules."""
