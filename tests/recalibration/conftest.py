"""The twin that is recalibrated is the one that is calibrated."""

from tests.estimation.conftest import twin as twin
