"""Calibration: the values of a model, fitted to recordings over a space of parameters."""
