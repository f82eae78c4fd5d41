"""The twin on Zenoh. Imports are absolute: `zenoh` is the wheel."""
