"""Slow proof: measurements that take minutes, each made by one command."""

import twin_daemon  # noqa: F401 before numpy: it says with how many threads
