"""Effects that are data: laws that were found in recordings, each a file of numbers in the state folder.

Nothing of such a file is run. It is read with bounds on its size and checked field by field; one that is broken is left
out, and named in one line where somebody asks for it.
"""

from twin_daemon.effects.from_files.effect import effect_of
from twin_daemon.effects.from_files.schema import EffectFile, folder, load_effect_file, save_effect_file

__all__ = ["EffectFile", "effect_of", "folder", "load_effect_file", "save_effect_file"]
