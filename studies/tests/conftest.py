"""Tests of the studies run under the same rules as those of the bench, and with their fixtures."""

from tests.conftest import *  # noqa: F403
