# %% [markdown]
# # A hand with something hidden in it
#
# No hardware is needed: a stand-in takes the hand's place, written apart from the twin. One of its sensors reads a
# tenth too much. Run this in an empty folder, cell by cell (Jupyter with jupytext, or VS Code).

# %%
import subprocess

import twin_daemon as td
from twin_daemon.resources import twin_command

HIDDEN = ["--hidden", "sensor_gain:rh_FFJ3=1.1", "--joint", "rh_FFJ3", "--seconds", "5"]
for take, name in enumerate(("fit.mcap", "validation.mcap")):
    command = twin_command("hand", *HIDDEN, "--take", str(take), "--output", name)
    subprocess.run(command, check=True)

# %% [markdown]
# ## Look at the data, then at the error

# %%
hand = td.hand("shadow_hand")
fit, validation = td.recording("fit.mcap", hand), td.recording("validation.mcap", hand)
before = td.compare(validation, version="nominal")
before.table()

# %%
before.figure()

# %% [markdown]
# ## Ask what is missing
#
# Every effect of the library is fitted wherever it could act. It counts only if motion that it was not fitted to gets
# better by it.

# %%
found = td.diagnose(fit, validation, joints=["rh_FFJ3"], version="nominal")
found.table()

# %%
found.figure()

# %% [markdown]
# ## Add it and see the error fall

# %%
added = td.add(finding=found)
after = td.compare(validation, version=added.version)
print(f"{before.mse_rad2:.3g} -> {after.mse_rad2:.3g} rad² on motion that nothing was fitted to")

# %%
td.versions(hand).table()
