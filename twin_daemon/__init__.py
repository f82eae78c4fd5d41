"""A live digital twin of a dexterous hand that knows what it does not model."""

__version__ = "0.1.0"
