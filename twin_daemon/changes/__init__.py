"""What has changed between two sessions of one robot: both are explained at once, and a change moves only the later."""
