"""Following the wear of a hand: fit around the version in use, decide, and name what has appeared."""
