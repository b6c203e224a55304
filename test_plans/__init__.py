"""The test plans of the bench and their building blocks. `test_plans.discovery` finds the plans."""
