"""The hand of the tests of estimation."""

from tests.estimation.conftest import twin as twin
