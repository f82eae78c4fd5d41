"""What a hand is told: planned trajectories and recorded command streams."""
