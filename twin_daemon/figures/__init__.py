"""Figures for command line, report and page alike (Plotly)."""
