"""The FMUs of the bench's tests."""

from tests.fmu.conftest import alone, car_fmus, spring_fmus

__all__ = ["alone", "car_fmus", "spring_fmus"]
