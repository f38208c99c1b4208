"""Hardware-in-the-loop bench: the runtime, the real firmware cores and a MuJoCo robot on a simulated wall."""
