"""The robot on the wall of a plan as a MuJoCo model: pages and the viewer draw it, the simulation moves it."""
