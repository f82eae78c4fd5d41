# %% [markdown]
# # A recording of a real robot
#
# Measurements of an SO-101 arm while it went through random way-points. `SO101` names the folder with `so101.xml`,
# `joint_map.yaml` and `random_waypoints`.

# %%
import os
from pathlib import Path

import twin_daemon as td

folder = Path(os.environ.get("SO101", "so101_real"))
arm = td.hand(model=folder / "so101.xml")
run = td.recording(folder / "random_waypoints", arm, joint_map=folder / "joint_map.yaml")
print(arm.joints, f"{run.time_s[-1]:.0f} s")

# %% [markdown]
# ## How far off is the model?
#
# The raw command is a predictor as well: a model that is worse than it explains nothing yet.

# %%
compared = td.compare(run)
print(compared.mse_rad2, compared.references["raw_command"].mse_rad2, compared.noise_floor_rad2)
compared.table()

# %%
compared.figure()

# %% [markdown]
# ## What could this recording tell of the model's parameters?

# %%
checked = td.check(run)
checked.table()

# %% [markdown]
# `td.diagnose(run)` asks next what the model lacks; it takes some minutes on a recording of this length.
