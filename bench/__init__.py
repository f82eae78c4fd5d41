"""Slow proof: measurements that take minutes, each made by one command."""
