"""Estimation: what a fit may move, the error as a function of it, searches, and how sure the values are."""
