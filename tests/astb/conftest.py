"""The virtual rig of the tests of plans, on which runs are watched."""

from tests.plans.conftest import bench_composed

__all__ = ["bench_composed"]
