"""A live digital twin of a dexterous hand that knows what it does not model."""

import os

__version__ = "0.1.0"

# Work is shared out among threads of our own. Those of the matrix library, which reads this as it is loaded, would wait
# for them and burn a core meanwhile.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
