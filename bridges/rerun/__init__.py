"""Comparisons for Rerun's viewer. The only package that imports the Rerun SDK, and only when it writes."""
