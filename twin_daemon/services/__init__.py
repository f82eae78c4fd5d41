"""What runs beside the daemon's loop: it is given its link to the network, and imports none."""
