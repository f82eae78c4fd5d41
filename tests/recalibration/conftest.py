"""The twin that is recalibrated is the one that is calibrated."""

from tests.fitting.conftest import twin as twin
