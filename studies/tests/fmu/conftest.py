"""The FMUs of the bench's tests."""

from tests.fmu.conftest import car_fmus, isolated, spring_fmus

__all__ = ["car_fmus", "isolated", "spring_fmus"]
