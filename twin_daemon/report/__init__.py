"""The report: one page that holds a comparison, what was learned from it, and how to do it again."""
