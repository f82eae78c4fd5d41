"""The gate: the one place that makes a command sendable to a hand. It is no certified stop."""
