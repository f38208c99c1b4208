# %% [markdown]
# # The log of a climb as tables
# `make climb` writes `out/telemetry.mcap`; CRUX_LOG names another one. Tables are NumPy record arrays with the names
# of `msgs/lcm`, one row a control cycle, limbs LF, RF, LR, RR.

# %%
import os
from dataclasses import asdict
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE
from crux_tools.telemetry import read_log
from crux_tools.telemetry.summary import summarise

log = read_log(Path(os.environ.get("CRUX_LOG", "out/telemetry.mcap")))
print(f"{log.time_s[-1]:.1f} s, {len(log.state)} cycles of {log.time_s[1] - log.time_s[0]:.3f} s")
for fault in log.faults:
    print(f"fault {FAULT_BY_CODE[int(fault['code'])].name} in cycle {fault['cycle']}")

# %% [markdown]
# ## Where the body is and where the controller wants it (frame W, by the runtime's own estimate)

# %%
body_mm = 1e3 * log.state["body_position_w_m"]
wanted_mm = 1e3 * log.state["body_reference_position_w_m"]
off_mm = np.linalg.norm(body_mm - wanted_mm, axis=1)
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(9, 5))
axes[0].plot(log.time_s, body_mm - body_mm[0], label=["x", "y", "z"])
axes[0].legend()
axes[0].set_ylabel("moved [mm]")
axes[1].plot(log.time_s, off_mm)
axes[1].set_ylabel("off its reference [mm]")
axes[1].set_xlabel("time [s]")
print(f"body off its reference: {off_mm.max():.2f} mm at most")

# %% [markdown]
# ## What each limb carries, measured and wanted [N]

# %%
fresh = log.limbs_fresh  # telemetry of limbs is in every tenth cycle; the rows between repeat it
figure, axes = plt.subplots(2, 2, sharex=True, sharey=True, figsize=(9, 5))
for limb, (name, axis) in enumerate(zip(LIMB_NAMES, axes.flat, strict=True)):
    for key, style in (("force_w_n", "-"), ("force_reference_w_n", "--")):
        axis.plot(log.time_s[fresh], np.linalg.norm(log.limbs[key][fresh, limb], axis=1), style, label=key)
    axis.set_title(name)
axes[0, 0].legend()

# %% [markdown]
# ## The figures that `crux replay` prints

# %%
summary = summarise(log)
for name, value in asdict(summary).items():
    print(f"{name}: {value}")
plt.show()
