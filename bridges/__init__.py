"""Transports of the live twin. They carry messages; what is right and wrong is decided in twin_daemon."""
